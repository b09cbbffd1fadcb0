!> A run between two calls as one array of reals: everything that decides how it goes on.
!>
!> `exchange` names each number once, for writing and for reading. The first are the counts of work:
!> Python reads them there. Then comes where that begins which decides how a run goes on; what lies
!> before, numbers of cycles and records and what is the largest so far, decides nothing.
module lapwing_run_checkpoint
  use lapwing_kinds, only: wp, int64
  use lapwing_flow, only: work_t
  use lapwing_hybrid_state, only: hybrid_state_t
  use lapwing_observers_averages, only: averages_t
  use lapwing_observers_records, only: sums_t, max_flights
  use lapwing_system, only: max_states
  use lapwing_observers_tangent, only: tangent_t
  implicit none
  private
  public :: blob_size, work_size, pack_blob, unpack_blob, pack_work, unpack_work, go_on_alike

  integer, parameter :: work_size = 9
  type(hybrid_state_t), parameter :: no_state = hybrid_state_t()
  type(sums_t), parameter :: no_sums = sums_t()
  !> Room for each number by itself, the smallest of which is an integer; and for the border.
  integer, parameter :: blob_size = work_size + 1 + max_flights + (storage_size(no_state) &
      + storage_size(no_sums) - max_flights*storage_size(0.0_wp))/storage_size(0)

  !> A number, or some, to or from the next places of a blob.
  interface pass
    procedure :: pass_real, pass_reals, pass_integer, pass_logical
  end interface pass

contains

  !> Write state, sums and counts.
  pure subroutine pack_blob(state, sums, work, blob)
    type(hybrid_state_t), intent(in) :: state    !! state
    type(sums_t), intent(in) :: sums             !! observers' sums
    type(work_t), intent(in) :: work             !! counts
    real(wp), intent(out) :: blob(:)             !! (blob_size)
    type(hybrid_state_t) :: state_of
    type(sums_t) :: sums_of
    type(work_t) :: work_of
    state_of = state
    sums_of = sums
    work_of = work
    blob = 0
    call exchange(blob, .true., state_of, sums_of, work_of)
  end subroutine pack_blob

  !> Read them back.
  pure subroutine unpack_blob(blob, state, sums, work)
    real(wp), intent(in) :: blob(:)               !! (blob_size)
    type(hybrid_state_t), intent(out) :: state    !! state
    type(sums_t), intent(out) :: sums             !! observers' sums
    type(work_t), intent(out) :: work             !! counts
    real(wp) :: copy(blob_size)
    copy = blob
    call exchange(copy, .false., state, sums, work)
  end subroutine unpack_blob

  !> Every number of a run, once: into the blob, or out of it.
  pure subroutine exchange(blob, writes, state, sums, work)
    real(wp), intent(inout) :: blob(:)              !! (blob_size)
    logical, intent(in) :: writes                   !! into it
    type(hybrid_state_t), intent(inout) :: state    !! state
    type(sums_t), intent(inout) :: sums             !! observers' sums
    type(work_t), intent(inout) :: work             !! counts
    real(wp) :: counts(work_size), border
    integer :: at
    at = 0
    counts = pack_work(work)
    call pass(blob, at, writes, counts)
    work = unpack_work(counts)
    at = at + 1
    call pass(blob, at, writes, state%instant%cycle)
    call pass(blob, at, writes, sums%n_log)
    call pass(blob, at, writes, sums%n_cycles)
    call pass(blob, at, writes, sums%next_sample)
    call pass(blob, at, writes, sums%strobe)
    call pass(blob, at, writes, sums%strobe_others)
    call pass(blob, at, writes, sums%fastest)
    border = at + 1
    if (writes) blob(work_size + 1) = border
    associate (instant => state%instant)
      call pass(blob, at, writes, instant%motion_state)
      call pass(blob, at, writes, instant%chart)
      call pass(blob, at, writes, instant%touching)
      call pass(blob, at, writes, instant%piece)
      call pass(blob, at, writes, instant%t)
      call pass(blob, at, writes, instant%y)
    end associate
    call pass(blob, at, writes, state%memory%step)
    call pass(blob, at, writes, state%memory%ratio)
    call pass(blob, at, writes, state%events_in_cycle)
    call pass(blob, at, writes, state%steps_in_cycle)
    call pass(blob, at, writes, state%leaving)
    call pass(blob, at, writes, state%fastest)
    call pass(blob, at, writes, sums%strobe_due)
    call pass(blob, at, writes, sums%states_visited)
    call pass(blob, at, writes, sums%counter)
    call pass(blob, at, writes, sums%flight_depth)
    call pass(blob, at, writes, sums%flight_depth_before)
    call pass(blob, at, writes, sums%flight_known)
    call pass(blob, at, writes, sums%flights_watched)
    call pass(blob, at, writes, sums%cycles_watched)
    call pass(blob, at, writes, sums%cycle_depth)
    call pass(blob, at, writes, sums%back_penetration)
    call pass(blob, at, writes, sums%grazes_known_to)
    call exchange_averages(blob, at, writes, sums%averages)
    call exchange_tangent(blob, at, writes, sums%tangent)
    call pass(blob, at, writes, sums%n_flights)
    call pass(blob, at, writes, sums%flight(:sums%n_flights))
  end subroutine exchange

  !> The same of the integrals over the cycle so far.
  pure subroutine exchange_averages(blob, at, writes, averages)
    real(wp), intent(inout) :: blob(:)              !! (blob_size)
    integer, intent(inout) :: at                    !! last place taken
    logical, intent(in) :: writes                   !! into it
    type(averages_t), intent(inout) :: averages     !! integrals since the cycle began
    call pass(blob, at, writes, averages%time)
    call pass(blob, at, writes, averages%phi)
    call pass(blob, at, writes, averages%phi_square)
    call pass(blob, at, writes, averages%force)
    call pass(blob, at, writes, averages%peak)
  end subroutine exchange_averages

  !> The same of a tangent map.
  pure subroutine exchange_tangent(blob, at, writes, tangent)
    real(wp), intent(inout) :: blob(:)              !! (blob_size)
    integer, intent(inout) :: at                    !! last place taken
    logical, intent(in) :: writes                   !! into it
    type(tangent_t), intent(inout) :: tangent       !! tangent map since the cycle began
    integer :: k
    do k = 1, max_states
      call pass(blob, at, writes, tangent%m(:, k))
    end do
    call pass(blob, at, writes, tangent%exponent)
    call pass(blob, at, writes, tangent%log_det)
    call pass(blob, at, writes, tangent%det_sign)
    call pass(blob, at, writes, tangent%lost)
    call pass(blob, at, writes, tangent%contact_time)
    call pass(blob, at, writes, tangent%pending)
    call pass(blob, at, writes, tangent%impacts)
    call pass(blob, at, writes, tangent%log_rebound)
    call pass(blob, at, writes, tangent%graze_depth)
  end subroutine exchange_tangent

  pure subroutine pass_real(blob, at, writes, x)
    real(wp), intent(inout) :: blob(:)   !! (blob_size)
    integer, intent(inout) :: at         !! last place taken
    logical, intent(in) :: writes        !! into it
    real(wp), intent(inout) :: x         !! the number
    at = at + 1
    if (writes) then
      blob(at) = x
    else
      x = blob(at)
    end if
  end subroutine pass_real

  pure subroutine pass_reals(blob, at, writes, x)
    real(wp), intent(inout) :: blob(:)   !! (blob_size)
    integer, intent(inout) :: at         !! last place taken
    logical, intent(in) :: writes        !! into it
    real(wp), intent(inout) :: x(:)      !! the numbers
    if (writes) then
      blob(at + 1:at + size(x)) = x
    else
      x = blob(at + 1:at + size(x))
    end if
    at = at + size(x)
  end subroutine pass_reals

  pure subroutine pass_integer(blob, at, writes, n)
    real(wp), intent(inout) :: blob(:)   !! (blob_size)
    integer, intent(inout) :: at         !! last place taken
    logical, intent(in) :: writes        !! into it
    integer, intent(inout) :: n          !! the number
    real(wp) :: x
    x = n
    call pass_real(blob, at, writes, x)
    n = nint(x)
  end subroutine pass_integer

  pure subroutine pass_logical(blob, at, writes, flag)
    real(wp), intent(inout) :: blob(:)   !! (blob_size)
    integer, intent(inout) :: at         !! last place taken
    logical, intent(in) :: writes        !! into it
    logical, intent(inout) :: flag       !! 1: true
    integer :: n
    n = merge(1, 0, flag)
    call pass_integer(blob, at, writes, n)
    flag = n == 1
  end subroutine pass_logical

  !> Whether two runs at the beginning of a cycle go on alike, bit for bit, but for the numbers of
  !> cycles, records and work. The state that the cycle before began with decides nothing any more,
  !> nor does what is the largest so far.
  pure logical function go_on_alike(one, other)
    real(wp), intent(in) :: one(blob_size), other(blob_size)   !! blobs
    integer(int64) :: none(1)
    integer :: first
    first = nint(one(work_size + 1))
    go_on_alike = all(transfer(one(first:), none) == transfer(other(first:), none))
  end function go_on_alike

  pure function pack_work(work) result(array)
    type(work_t), intent(in) :: work   !! counts
    real(wp) :: array(work_size)
    array = [work%steps, work%rejected, work%polish_steps, work%drive_searches, &
        work%coast_searches, work%samples, work%depth_searches, work%graze_searches, &
        work%arcs]
  end function pack_work

  pure function unpack_work(array) result(work)
    real(wp), intent(in) :: array(work_size)   !! counts
    type(work_t) :: work
    work = work_t(array(1), array(2), array(3), array(4), array(5), array(6), array(7), array(8), &
        array(9))
  end function unpack_work
end module lapwing_run_checkpoint
