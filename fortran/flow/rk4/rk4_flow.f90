!> Motion in steps of the classical formula, of any system: an arc is one accepted step, cut at the
!> first guard in it. Where nobody looks at the steps of a contact several are taken at once, and
!> the arc is the last of them.
module lapwing_flow_rk4_rk4_flow
  use lapwing_kinds, only: wp
  use lapwing_codes, only: separation, no_flank, drive_flank, status_ok, status_step_too_small, &
      status_not_finite
  use lapwing_flow, only: flow_t, arc_t, reached_t, work_t, step_memory_t, listener_t, instant_on, &
      at_stop
  use lapwing_flow_rk4_crossing, only: crossing_t, find_crossing, polish_crossing
  use lapwing_flow_rk4_step, only: take_stages, estimate_error, set_dense, ratio_beyond_rounding
  use lapwing_flow_rk4_step_control, only: step_to_try, allowed_error, error_ratio, &
      after_accepted, after_rejected
  use lapwing_polynomial_evaluation, only: max_degree, horner, upper_bound
  use lapwing_polynomial_roots, only: critical_points, raise_to_largest
  use lapwing_system, only: system_t, instant_t, frame_t, step_t, max_states
  implicit none
  private
  public :: rk4_flow_t

  type, extends(flow_t) :: rk4_flow_t
  contains
    procedure :: open, advance, state_at, farthest, near_turns
  end type rk4_flow_t

contains

  !> The system's frame, as far as a step may go.
  subroutine open(self, system, instant, frame)
    class(rk4_flow_t), intent(in) :: self
    class(system_t), intent(in) :: system         !! what moves
    type(instant_t), intent(in) :: instant        !! where the step begins
    type(frame_t), intent(inout) :: frame         !! its frame
    call system%open_frame(instant, frame)
    call system%limit_step(instant, frame)
  end subroutine open

  !> One accepted step, to its end or the first crossing in it.
  subroutine advance(self, system, tolerance, opened, arc, memory, reached, work, status)
    class(rk4_flow_t), intent(in) :: self
    class(system_t), intent(in) :: system         !! what moves
    real(wp), intent(in) :: tolerance             !! relative, per step
    logical, intent(in) :: opened                 !! without effect: it is
    type(arc_t), intent(inout) :: arc             !! the arc; its motion is set
    type(step_memory_t), intent(inout) :: memory(0:)   !! by motion state
    type(reached_t), intent(inout) :: reached     !! its end
    type(work_t), intent(inout) :: work           !! counts
    integer, intent(out) :: status                !! status_*
    type(step_t) :: step
    real(wp) :: scale(max_states), allowed(max_states), h
    integer :: n, i
    logical :: in_contact, stays
    n = system%n_states
    ! Without memory for them, lengths are not kept.
    if (.not. allocated(arc%motion%lengths)) allocate (arc%motion%lengths, stat=i)
    call system%scales(arc%begin%motion_state, scale)
    allowed(:n) = allowed_error(scale(:n), tolerance)
    in_contact = arc%begin%motion_state /= separation
    stays = .false.
    reached%flank = no_flank
    reached%chart = arc%begin%chart
    reached%piece = arc%begin%piece
    do
      call accept_step(system, tolerance, allowed, arc, memory(arc%begin%motion_state), h, step, &
          work, status)
      if (status /= status_ok) return
      reached%s = h
      if (.not. in_contact) exit
      ! Whether the tooth stays inside is told by its position alone.
      call set_dense(step, h, arc%begin%y, 1, 1, arc%motion)
      call system%stay(arc%frame, arc%begin, arc%motion, step%end, reached%y, stays)
      if (.not. stays) exit
      if (arc%skipped >= arc%may_skip .or. h >= arc%frame%stop) exit
      if (.not. abs(sum(reached%y(:n))) <= huge(1.0_wp)) exit
      arc%skipped = arc%skipped + 1
      arc%begin%t = arc%begin%t + h
      arc%begin%touching = no_flank
      !GCC$ novector
      do i = 1, n
        arc%begin%y(i) = reached%y(i)
      end do
      call self%open(system, arc%begin, arc%frame)
    end do
    call set_dense(step, h, arc%begin%y, merge(2, 1, in_contact), n, arc%motion)
    if (stays) return
    call cut_at_crossing(system, arc, step%end, reached, work)
  end subroutine advance

  !> End an arc at the first crossing in its step, if there is one.
  subroutine cut_at_crossing(system, arc, z_end, reached, work)
    class(system_t), intent(in) :: system         !! what moves
    type(arc_t), intent(inout) :: arc             !! the arc
    real(wp), intent(in) :: z_end(max_states)     !! local coordinates at the step's end
    type(reached_t), intent(inout) :: reached     !! the arc's end
    type(work_t), intent(inout) :: work           !! counts
    type(crossing_t) :: crossing
    real(wp) :: z_event(max_states)
    call system%complete_frame(arc%frame)
    call find_crossing(system, arc%frame, arc%begin%motion_state, arc%begin%touching, arc%motion, &
        work, crossing)
    if (crossing%found) then
      call polish_crossing(system, arc%frame, arc%begin%motion_state, arc%motion%h, arc%begin%y, &
          crossing, z_event, work)
      if (at_stop(arc%frame, crossing%s)) then
        crossing%found = .false.
        do while (crossing%frame%piece_end < arc%motion%h)
          call system%next_piece(crossing%frame)
        end do
      end if
    end if
    if (crossing%found) then
      reached%flank = crossing%flank
      reached%s = crossing%s
      reached%chart = crossing%flank
      reached%piece = arc%begin%piece
      call system%commit(crossing%frame, crossing%s, z_event, crossing%flank, reached%y)
      if (system%law%asks_flank_velocity()) reached%flank_velocity = &
          system%flank_velocity(crossing%frame, crossing%flank, crossing%s)
    else
      reached%piece = crossing%frame%piece
      call system%commit(crossing%frame, arc%motion%h, z_end, arc%begin%chart, reached%y)
    end if
  end subroutine cut_at_crossing

  !> Try steps until the error estimate is within the tolerance.
  subroutine accept_step(system, tolerance, allowed, arc, memory, h, step, work, status)
    class(system_t), intent(in) :: system           !! what moves
    real(wp), intent(in) :: tolerance               !! relative
    real(wp), intent(in) :: allowed(max_states)     !! error that a step may make
    type(arc_t), intent(inout) :: arc               !! where the step begins
    type(step_memory_t), intent(inout) :: memory    !! of its motion state
    real(wp), intent(out) :: h                      !! its length
    type(step_t), intent(inout) :: step             !! its stages
    type(work_t), intent(inout) :: work             !! counts
    integer, intent(out) :: status                  !! status_*
    real(wp) :: error(max_states), ratio
    logical :: cut_short, in_contact
    integer :: n
    n = system%n_states
    status = status_ok
    in_contact = arc%begin%motion_state /= separation
    h = step_to_try(memory, in_contact, tolerance)
    cut_short = arc%frame%stop < h
    h = min(h, arc%frame%stop)
    associate (z => arc%begin%y)
      do
        call take_stages(system, arc%frame, arc%begin%motion_state, h, z, arc%motion%lengths, step)
        call estimate_error(step, h, z(:n), error(:n))
        ratio = error_ratio(error(:n), allowed(:n))
        if (ratio <= 1) exit
        if (in_contact) ratio = ratio_beyond_rounding(h, z(:n), error(:n), allowed(:n))
        if (ratio <= 1) exit
        work%rejected = work%rejected + 1
        cut_short = .false.
        h = after_rejected(h, ratio)
        if (h <= spacing(system%period)) then
          status = merge(status_step_too_small, status_not_finite, abs(sum(z(:n))) <= huge(h))
          return
        end if
      end do
    end associate
    call after_accepted(memory, h, ratio, cut_short)
    work%steps = work%steps + 1
  end subroutine accept_step

  !> Dense output at a time of a step.
  subroutine state_at(self, system, arc, s, frame, y)
    class(rk4_flow_t), intent(in) :: self
    class(system_t), intent(in) :: system         !! what moves
    type(arc_t), intent(in) :: arc                !! a step it took
    real(wp), intent(in) :: s                     !! time since it began
    type(frame_t), intent(inout) :: frame         !! its frame, moved on to the piece that holds s
    real(wp), intent(out) :: y(max_states)        !! state variables
    real(wp) :: z(max_states)
    integer :: i
    call system%complete_frame(frame)
    do while (s > frame%piece_end .and. frame%piece_end < arc%length)
      call system%next_piece(frame)
    end do
    z = 0
    do i = 1, system%n_states
      z(i) = horner(arc%motion%dense(:, i), s/arc%motion%h)
    end do
    call system%commit(frame, s, z, frame%chart, y)
  end subroutine state_at

  !> Largest distance from the drive flank, or depth in the coast flank, piece by piece: Bernstein
  !> coefficients bound it from above, so that most pieces cost no root search. In a flight most
  !> are not even bounded: a depth it reaches is known first, and how long it stays below that.
  subroutine farthest(self, system, arc, flank, least, largest, work)
    class(rk4_flow_t), intent(in) :: self
    class(system_t), intent(in) :: system         !! what moves
    type(arc_t), intent(in) :: arc                !! a step it took
    integer, intent(in) :: flank
    real(wp), intent(in) :: least                 !! value known already, rad
    real(wp), intent(out) :: largest              !! the larger of the two, rad
    type(work_t), intent(inout) :: work           !! counts
    type(frame_t) :: frame
    real(wp) :: c(0:max_degree), finish, floor, until
    logical :: leaps
    largest = least
    floor = least
    until = 0
    frame = arc%frame
    call system%complete_frame(frame)
    leaps = arc%begin%motion_state == separation .and. frame%piece_end < arc%length
    do
      finish = min(frame%piece_end, arc%length)
      if (leaps .and. until <= frame%piece_begin) then
        call system%bound_depth(arc%motion, arc%length, frame, floor, until)
      end if
      if (until < finish) then
        call system%gap(frame, flank, arc%motion, c)
        if (flank /= drive_flank) c = -c
        if (upper_bound(c, finish - frame%piece_begin) > max(largest, floor)) then
          work%depth_searches = work%depth_searches + 1
          call raise_to_largest(c, finish - frame%piece_begin, largest)
        end if
      end if
      if (frame%piece_end >= arc%length) return
      call system%next_piece(frame)
    end do
  end subroutine farthest

  !> Report where a step comes near a flank, or near release, and turns back: piece by piece.
  subroutine near_turns(self, system, arc, within, listener, work)
    class(rk4_flow_t), intent(in) :: self
    class(system_t), intent(in) :: system         !! what moves
    type(arc_t), intent(in) :: arc                !! a step it took
    real(wp), intent(in) :: within                !! what is near, rad
    class(listener_t), intent(inout) :: listener  !! who hears of it
    type(work_t), intent(inout) :: work           !! counts
    type(frame_t) :: frame
    integer :: flank
    frame = arc%frame
    call system%complete_frame(frame)
    do
      do flank = 1, system%n_flanks
        if (arc%begin%motion_state /= separation .and. arc%begin%motion_state /= flank) cycle
        call near_turns_on_piece(self, system, arc, frame, flank, within, listener, work)
      end do
      if (frame%piece_end >= arc%length) return
      call system%next_piece(frame)
    end do
  end subroutine near_turns

  !> The same for one flank on one piece.
  subroutine near_turns_on_piece(self, system, arc, frame, flank, within, listener, work)
    class(rk4_flow_t), intent(in) :: self
    class(system_t), intent(in) :: system         !! what moves
    type(arc_t), intent(in) :: arc                !! a step it took
    type(frame_t), intent(in) :: frame            !! frame on the piece
    integer, intent(in) :: flank
    real(wp), intent(in) :: within                !! what is near, rad
    class(listener_t), intent(inout) :: listener  !! who hears of it
    type(work_t), intent(inout) :: work           !! counts
    !> Part of the piece before a turn, where the distance must be larger: a minimum.
    real(wp), parameter :: before = 1.0e-3_wp
    !> A distance that varies no more over the piece, in parts of it, turns by rounding alone.
    real(wp), parameter :: still = 1000*epsilon(1.0_wp)
    real(wp) :: c(0:max_degree), length, at(max_degree), distance
    type(instant_t) :: instant
    type(frame_t) :: here
    integer :: i, n
    length = min(frame%piece_end, arc%length) - frame%piece_begin
    call system%gap(frame, flank, arc%motion, c)
    if (arc%begin%motion_state /= separation) c = -c
    if (-upper_bound(-c, length) > within) return
    work%graze_searches = work%graze_searches + 1
    call critical_points(c, length, n, at)
    do i = 1, n
      distance = horner(c, at(i))
      if (distance <= 0 .or. distance > within) cycle
      if (horner(c, at(i) - before*length) < distance) cycle
      if (max(c(0), horner(c, length)) - distance <= still*distance) cycle
      here = frame
      call instant_on(self, system, arc, frame%piece_begin + at(i), here, instant)
      call listener%hear(flank, instant)
    end do
  end subroutine near_turns_on_piece
end module lapwing_flow_rk4_rk4_flow
