!> A run between two calls as one array of reals: everything that decides how it goes on.
module lapwing_run_checkpoint
  use lapwing_kinds, only: wp, int64
  use lapwing_flow, only: work_t
  use lapwing_hybrid_state, only: hybrid_state_t
  use lapwing_observers_records, only: sums_t, max_flights
  use lapwing_system, only: max_states
  use lapwing_observers_tangent, only: tangent_t
  implicit none
  private
  public :: blob_size, work_size, pack_blob, unpack_blob, pack_work, unpack_work, go_on_alike

  integer, parameter :: work_size = 9
  !> The counts come first: Python reads them there.
  integer, parameter :: at = work_size
  integer, parameter :: map_size = max_states**2
  integer, parameter :: tangent_size = map_size + 10
  integer, parameter :: state_at = at + 37
  integer, parameter :: tangent_at = state_at + max_states
  integer, parameter :: others_at = tangent_at + tangent_size
  integer, parameter :: fixed_size = others_at + max_states - 2
  integer, parameter :: blob_size = fixed_size + max_flights

contains

  !> Write state, sums and counts.
  pure subroutine pack_blob(state, sums, work, blob)
    type(hybrid_state_t), intent(in) :: state    !! state
    type(sums_t), intent(in) :: sums             !! observers' sums
    type(work_t), intent(in) :: work             !! counts
    real(wp), intent(out) :: blob(:)             !! (blob_size)
    integer :: n
    associate (instant => state%instant)
      blob = 0
      blob(1:work_size) = pack_work(work)
      blob(at + 1:at + 6) = real([instant%motion_state, instant%chart, instant%touching, &
          instant%cycle, instant%piece, state%events_in_cycle], wp)
      blob(at + 7:at + 8) = [real(state%steps_in_cycle, wp), instant%t]
      blob(at + 9:at + 14) = [state%memory%step, state%memory%ratio]
    end associate
    blob(at + 15:at + 20) = real([sums%n_log, sums%n_cycles, sums%next_sample, &
        merge(1, 0, sums%strobe_due), sums%states_visited, sums%n_flights], wp)
    blob(at + 21:at + 28) = sums%counter
    blob(at + 29:at + 36) = [sums%flight_depth, sums%cycle_depth, sums%back_penetration, &
        sums%strobe, sums%flight_depth_before, sums%grazes_known_to]
    blob(state_at) = sums%fastest
    blob(state_at + 1:tangent_at) = state%instant%y
    blob(tangent_at + 1:others_at) = pack_tangent(sums%tangent)
    blob(others_at + 1:fixed_size) = sums%strobe_others
    n = sums%n_flights
    blob(fixed_size + 1:fixed_size + n) = sums%flight(1:n)
  end subroutine pack_blob

  !> Read them back.
  pure subroutine unpack_blob(blob, state, sums, work)
    real(wp), intent(in) :: blob(:)               !! (blob_size)
    type(hybrid_state_t), intent(out) :: state    !! state
    type(sums_t), intent(out) :: sums             !! observers' sums
    type(work_t), intent(out) :: work             !! counts
    integer :: number(13), n
    number = nint(blob(at + [1, 2, 3, 4, 5, 6, 7, 15, 16, 17, 18, 19, 20]))
    associate (instant => state%instant)
      instant%motion_state = number(1)
      instant%chart = number(2)
      instant%touching = number(3)
      instant%cycle = number(4)
      instant%piece = number(5)
      instant%t = blob(at + 8)
      instant%y = blob(state_at + 1:tangent_at)
    end associate
    state%events_in_cycle = number(6)
    state%steps_in_cycle = number(7)
    state%memory%step = blob(at + 9:at + 11)
    state%memory%ratio = blob(at + 12:at + 14)
    sums%n_log = number(8)
    sums%n_cycles = number(9)
    sums%next_sample = number(10)
    sums%strobe_due = number(11) == 1
    sums%states_visited = number(12)
    sums%n_flights = number(13)
    sums%counter = blob(at + 21:at + 28)
    sums%flight_depth = blob(at + 29)
    sums%cycle_depth = blob(at + 30)
    sums%back_penetration = blob(at + 31)
    sums%strobe = blob(at + 32:at + 34)
    sums%flight_depth_before = blob(at + 35)
    sums%grazes_known_to = blob(at + 36)
    sums%fastest = blob(state_at)
    sums%tangent = unpack_tangent(blob(tangent_at + 1:others_at))
    sums%strobe_others = blob(others_at + 1:fixed_size)
    work = unpack_work(blob(1:work_size))
    n = sums%n_flights
    sums%flight(1:n) = blob(fixed_size + 1:fixed_size + n)
  end subroutine unpack_blob

  !> Whether two runs at the beginning of a cycle go on the same way, bit for bit, but for the
  !> numbers of cycles, records and work. The state that the cycle before began with decides nothing
  !> any more, nor does what is the largest so far.
  pure logical function go_on_alike(one, other)
    real(wp), intent(in) :: one(blob_size), other(blob_size)   !! blobs
    logical :: counts(blob_size)
    integer(int64) :: zero(1)
    zero = 0
    counts = .false.
    counts(1:work_size) = .true.
    counts(at + [4, 15, 16, 17, 32, 33, 34]) = .true.
    counts(state_at) = .true.
    counts(others_at + 1:fixed_size) = .true.
    go_on_alike = all(transfer(merge(0.0_wp, one, counts), zero) &
        == transfer(merge(0.0_wp, other, counts), zero))
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

  pure function pack_tangent(tangent) result(array)
    type(tangent_t), intent(in) :: tangent   !! tangent map since the cycle began
    real(wp) :: array(tangent_size)
    array = [tangent%m, real([tangent%exponent, tangent%det_sign, tangent%lost, &
        tangent%impacts], wp), tangent%log_det, tangent%contact_time, tangent%log_rebound, &
        tangent%graze_depth, tangent%pending]
  end function pack_tangent

  pure function unpack_tangent(array) result(tangent)
    real(wp), intent(in) :: array(tangent_size)
    type(tangent_t) :: tangent
    tangent%m = reshape(array(:map_size), shape(tangent%m))
    associate (rest => array(map_size + 1:))
      tangent%exponent = nint(rest(1))
      tangent%det_sign = nint(rest(2))
      tangent%lost = nint(rest(3))
      tangent%impacts = nint(rest(4))
      tangent%log_det = rest(5)
      tangent%contact_time = rest(6:7)
      tangent%log_rebound = rest(8)
      tangent%graze_depth = rest(9)
      tangent%pending = rest(10)
    end associate
  end function unpack_tangent
end module lapwing_run_checkpoint
