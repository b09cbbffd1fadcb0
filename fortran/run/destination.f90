!> Where motions of one system end: each is followed until its section, where a cycle begins, is one
!> of a motion that is known.
!>
!> A known periodic motion has a goal at each of its states on the section, with a metric S in which
!> the map over one period contracts: V = (x - x0)' S (x - x0).
!> 1. V <= `certain`: everything there comes to the motion (the caller has seen to it).
!> 2. V <= `presumed`, and V has fallen from each return to this goal to the next so many times
!>    running: it is taken to go on doing so.
!> A known aperiodic motion is a set of cells of the section.
!> 3. So many cycles running have begun in cells of one motion: it is taken to be that motion.
!> A motion of which none of this holds when its cycles are spent has no destination.
module lapwing_run_destination
  use lapwing_kinds, only: wp, int64
  use lapwing_codes, only: status_ok, status_unfinished, end_unknown, end_certain, &
      end_presumed
  use lapwing_flow, only: flow_t, work_t
  use lapwing_hybrid_automaton, only: advance
  use lapwing_hybrid_state, only: hybrid_state_t, numerics_t, segment_t
  use lapwing_observers_records, only: sums_t
  use lapwing_run, only: past, segments_per_look
  use lapwing_run_checkpoint, only: blob_size, pack_blob, unpack_blob
  use lapwing_system, only: instant_t
  use lapwing_system_oscillator, only: oscillator_t
  use lapwing_system_start, only: start_of_run
  implicit none
  private
  public :: known_t, follow_starts, goal_columns, end_columns, suspended_size

  !> Number of the motion, from 1; motion state, period in cycles; phi, phi'; S11, S12, S22;
  !> `certain`, `presumed`.
  integer, parameter :: goal_columns = 10
  !> Status, number of the motion (0: none), end_*, cycles completed; motion state, phi, phi'
  !> at the beginning of the last.
  integer, parameter :: end_columns = 7

  !> What is known of the system's motions.
  type :: known_t
    real(wp), pointer, contiguous :: goals(:, :) => null()   !! (goal_columns, n), number 0: none
    integer, pointer, contiguous :: cells(:, :) => null()    !! number of the motion that visits a
                                                             !! cell, 0: none, -1: several
    real(wp) :: box(4) = 0         !! least and greatest phi and phi' of the cells
    integer :: most_cycles = 0     !! cycles of a run
    integer :: returns = 0         !! returns, each nearer, that presume an end
    integer :: recurrences = 0     !! cycles in an aperiodic motion's cells that presume one
  end type known_t

  !> What a run remembers of its own section.
  type :: pursuit_t
    integer :: goal = 0            !! goal that it was near to, 0: none
    integer :: due = 0             !! cycle in which it would come back there
    integer :: nearer = 0          !! returns, each nearer than the one before
    real(wp) :: distance = 0       !! V at the last of them
    integer :: motion = 0          !! aperiodic motion in whose cells it is
    integer :: inside = 0          !! cycles running
    integer :: strobe_due = 0      !! 1: a cycle begins with the next arc of some length
  end type pursuit_t

  integer, parameter :: pursuit_size = 7
  !> Next start, whether its run is under way (1), the run.
  integer, parameter :: suspended_size = 2 + pursuit_size + blob_size

contains

  !> Follow starts one after the other, until all are done or the deadline has come.
  subroutine follow_starts(system, flow, numerics, known, starts, deadline, suspended, ends)
    class(oscillator_t), intent(in) :: system        !! what moves
    class(flow_t), intent(in) :: flow                !! how
    type(numerics_t), intent(in) :: numerics         !! tolerances and bounds
    type(known_t), intent(in) :: known               !! motions known
    real(wp), intent(in) :: starts(:, :)             !! (4, n) see `start_of_run`
    integer(int64), intent(in) :: deadline           !! clock count at which to stop
    real(wp), intent(inout) :: suspended(:)         !! (suspended_size) at first 1, 0
    real(wp), intent(inout) :: ends(:, :)            !! (end_columns, n)
    type(hybrid_state_t) :: state
    type(pursuit_t) :: pursuit
    integer :: i, status
    do i = nint(suspended(1)), size(starts, 2)
      if (nint(suspended(2)) == 1) then
        call go_on_from(suspended, state, pursuit)
      else
        state = hybrid_state_t()
        state%instant = start_of_run(system, starts(:, i))
        pursuit = pursuit_t()
        if (state%instant%t <= 0) pursuit%strobe_due = 1
      end if
      call follow(system, flow, numerics, known, deadline, state, pursuit, ends(:, i), status)
      if (status == status_unfinished) then
        call keep(i, state, pursuit, suspended)
        return
      end if
      suspended(:2) = [real(i + 1, wp), 0.0_wp]
    end do
  end subroutine follow_starts

  !> One motion, to its end or the deadline.
  subroutine follow(system, flow, numerics, known, deadline, state, pursuit, ending, status)
    class(oscillator_t), intent(in) :: system        !! what moves
    class(flow_t), intent(in) :: flow                !! how
    type(numerics_t), intent(in) :: numerics         !! tolerances and bounds
    type(known_t), intent(in) :: known               !! motions known
    integer(int64), intent(in) :: deadline           !! clock count at which to stop
    type(hybrid_state_t), intent(inout) :: state     !! where it is
    type(pursuit_t), intent(inout) :: pursuit        !! what it remembers
    real(wp), intent(inout) :: ending(end_columns)   !! how it ended, if it did
    integer, intent(out) :: status                   !! status_*
    type(segment_t) :: segment
    type(work_t) :: work
    integer :: looks, motion, how
    status = status_ok
    looks = 0
    do
      looks = looks + 1
      if (looks == segments_per_look) then
        looks = 0
        if (past(deadline)) then
          status = status_unfinished
          return
        end if
      end if
      call advance(system, flow, numerics, state, segment, work, status)
      if (status /= status_ok) exit
      ! As the strobe of `recorder`: what happens at the section's own instant has happened.
      if (pursuit%strobe_due == 1 .and. segment%length > 0) then
        pursuit%strobe_due = 0
        call look(system, known, segment%begin, pursuit, motion, how)
        if (motion > 0 .or. segment%begin%cycle >= known%most_cycles) then
          call write_end(system, segment%begin, status_ok, motion, how, ending)
          return
        end if
      end if
      if (segment%cycle_completed) pursuit%strobe_due = 1
    end do
    call write_end(system, state%instant, status, 0, end_unknown, ending)
  end subroutine follow

  !> Fill the columns of an ending.
  subroutine write_end(system, instant, status, motion, how, ending)
    class(oscillator_t), intent(in) :: system        !! what moves
    type(instant_t), intent(in) :: instant           !! where it is
    integer, intent(in) :: status, motion, how       !! how it ended
    real(wp), intent(out) :: ending(end_columns)     !! all of it
    ending(:5) = real([status, motion, how, instant%cycle, instant%motion_state], wp)
    call system%observe(instant, ending(6), ending(7))
  end subroutine write_end

  !> Whether a motion is known by the state with which a cycle begins.
  subroutine look(system, known, instant, pursuit, motion, how)
    class(oscillator_t), intent(in) :: system        !! what moves
    type(known_t), intent(in) :: known               !! motions known
    type(instant_t), intent(in) :: instant           !! beginning of a cycle
    type(pursuit_t), intent(inout) :: pursuit        !! what the run remembers
    integer, intent(out) :: motion, how              !! number of the motion, 0: none; end_*
    real(wp) :: x(2), v, nearest
    integer :: i, near
    call system%observe(instant, x(1), x(2))
    motion = 0
    how = end_unknown
    near = 0
    nearest = huge(nearest)
    do i = 1, size(known%goals, 2)
      if (nint(known%goals(2, i)) /= instant%motion_state) cycle
      v = distance(known%goals(:, i), x)
      if (v <= known%goals(9, i)) then
        motion = nint(known%goals(1, i))
        how = end_certain
        return
      end if
      if (v > known%goals(10, i) .or. v >= nearest) cycle
      near = i
      nearest = v
    end do
    call count_returns(known, instant, x, near, nearest, pursuit)
    if (pursuit%nearer >= known%returns) motion = nint(known%goals(1, pursuit%goal))
    if (motion == 0) then
      call count_recurrences(known, x, pursuit)
      if (pursuit%inside >= known%recurrences) motion = pursuit%motion
    end if
    if (motion > 0) how = end_presumed
  end subroutine look

  !> V of a state and a goal.
  pure real(wp) function distance(goal, x)
    real(wp), intent(in) :: goal(goal_columns)       !! the goal
    real(wp), intent(in) :: x(2)                     !! phi, phi'
    real(wp) :: d(2)
    d = x - goal(4:5)
    distance = goal(6)*d(1)**2 + 2*goal(7)*d(1)*d(2) + goal(8)*d(2)**2
  end function distance

  !> Count how often it has come back to a goal, each time nearer.
  pure subroutine count_returns(known, instant, x, near, nearest, pursuit)
    type(known_t), intent(in) :: known               !! motions known
    type(instant_t), intent(in) :: instant           !! beginning of a cycle
    real(wp), intent(in) :: x(2)                     !! phi, phi' there
    integer, intent(in) :: near                      !! nearest goal within reach, 0: none
    real(wp), intent(in) :: nearest                  !! its V
    type(pursuit_t), intent(inout) :: pursuit        !! what the run remembers
    real(wp) :: v
    if (pursuit%goal > 0) then
      if (instant%cycle < pursuit%due) return
      associate (goal => known%goals(:, pursuit%goal))
        v = distance(goal, x)
        if (nint(goal(2)) == instant%motion_state .and. v < pursuit%distance) then
          pursuit%nearer = pursuit%nearer + 1
          pursuit%distance = v
          pursuit%due = pursuit%due + nint(goal(3))
          return
        end if
      end associate
    end if
    pursuit%goal = near
    pursuit%nearer = 0
    pursuit%distance = nearest
    if (near > 0) pursuit%due = instant%cycle + nint(known%goals(3, near))
  end subroutine count_returns

  !> Count the cycles that have begun in cells of one aperiodic motion. A cell of several is one of
  !> whichever it is.
  pure subroutine count_recurrences(known, x, pursuit)
    type(known_t), intent(in) :: known               !! motions known
    real(wp), intent(in) :: x(2)                     !! phi, phi' where a cycle begins
    type(pursuit_t), intent(inout) :: pursuit        !! what the run remembers
    real(wp) :: place(2)
    integer :: at(2), found
    place = (x - known%box([1, 3]))/(known%box([2, 4]) - known%box([1, 3]))
    found = 0
    if (all(place >= 0 .and. place < 1)) then
      at = int(place*shape(known%cells)) + 1
      found = known%cells(at(1), at(2))
    end if
    if (found < 0) return
    if (found == 0 .or. found /= pursuit%motion) pursuit%inside = 0
    pursuit%motion = found
    if (found > 0) pursuit%inside = pursuit%inside + 1
  end subroutine count_recurrences

  !> Keep the run under way.
  pure subroutine keep(start, state, pursuit, suspended)
    integer, intent(in) :: start                     !! its start
    type(hybrid_state_t), intent(in) :: state        !! where it is
    type(pursuit_t), intent(in) :: pursuit           !! what it remembers
    real(wp), intent(out) :: suspended(suspended_size)       !! all of it
    suspended(:2) = [start, 1]
    suspended(3:2 + pursuit_size) = [real([pursuit%goal, pursuit%due, pursuit%nearer], wp), &
        pursuit%distance, real([pursuit%motion, pursuit%inside, pursuit%strobe_due], wp)]
    call pack_blob(state, sums_t(), work_t(), suspended(3 + pursuit_size:))
  end subroutine keep

  !> Read it back.
  pure subroutine go_on_from(suspended, state, pursuit)
    real(wp), intent(in) :: suspended(suspended_size)       !! see `keep`
    type(hybrid_state_t), intent(out) :: state       !! where it is
    type(pursuit_t), intent(out) :: pursuit          !! what it remembers
    type(sums_t) :: sums
    type(work_t) :: work
    associate (p => suspended(3:2 + pursuit_size))
      pursuit = pursuit_t(nint(p(1)), nint(p(2)), nint(p(3)), p(4), nint(p(5)), nint(p(6)), &
          nint(p(7)))
    end associate
    call unpack_blob(suspended(3 + pursuit_size:), state, sums, work)
  end subroutine go_on_from
end module lapwing_run_destination
