!> The hybrid automaton: one call advances the state by one smooth stretch and resolves whatever
!> ends it. Serves any `system_t`. Corners are decided as docs/model.md says.
module lapwing_hybrid_automaton
  use lapwing_kinds, only: wp
  use lapwing_hybrid_chatter, only: remaining_chatter
  use lapwing_codes, only: separation, no_flank, drive_flank, event_kink, event_chatter_end, &
      status_ok, status_too_many_events, status_too_many_steps, status_step_too_small, &
      status_not_finite
  use lapwing_hybrid_impact, only: strike, strike_resting, begin_contact, let_go, pressing_sign, &
      log_event
  use lapwing_flow_rk4_crossing, only: crossing_t, find_crossing, polish_crossing, work_t
  use lapwing_hybrid_state, only: hybrid_state_t, numerics_t, segment_t
  use lapwing_polynomial_evaluation, only: max_degree
  use lapwing_polynomial_roots, only: first_descent
  use lapwing_flow_rk4_step, only: ratio_in_contact, rk4_step, rk4_move
  use lapwing_flow_rk4_step_control, only: step_memory_t, step_to_try, error_ratio, &
      after_accepted, after_rejected
  use lapwing_system, only: system_t, frame_t, reached_t, max_states
  implicit none
  private
  public :: advance, at_stop, check_bounds, pass_stop, end_of_step

contains

  !> Advance by one smooth stretch, or by none where the tooth stands at an event.
  subroutine advance(system, numerics, state, segment, work, status)
    class(system_t), intent(in) :: system           !! what moves
    type(numerics_t), intent(in) :: numerics        !! tolerances and bounds
    type(hybrid_state_t), intent(inout) :: state    !! state, moved on
    type(segment_t), intent(inout) :: segment       !! what happened
    type(work_t), intent(inout) :: work             !! counts
    integer, intent(out) :: status                  !! status_*
    real(wp) :: z(max_states)
    logical :: resolved
    status = status_ok
    segment%motion_state = state%instant%motion_state
    segment%cycle = state%instant%cycle
    segment%t = state%instant%t
    segment%length = 0
    segment%stepped = .false.
    segment%closed = .false.
    segment%n_events = 0
    segment%cycle_completed = .false.
    call system%open_frame(state%instant, segment%frame, z)
    if (segment%motion_state == separation) then
      call meet_flanks(system, numerics, state, segment, z, resolved)
    else
      call keep_contact(system, state, segment, z, resolved)
    end if
    if (.not. resolved) then
      if (system%rigid .and. segment%motion_state /= separation) then
        call follow(system, state, segment, z)
      else if (system%closed_form) then
        call stretch_on(system, state, segment, work)
      else
        call step_on(system, numerics, state, segment, z, work, status)
      end if
    end if
    if (status == status_ok) call check_bounds(system, numerics, state, segment, status)
  end subroutine advance

  !> In separation at the beginning of a stretch: strike a flank that is met already, sum a
  !> chatter that has become short, or know which flank is being left.
  subroutine meet_flanks(system, numerics, state, segment, z, resolved)
    class(system_t), intent(in) :: system           !! what moves
    type(numerics_t), intent(in) :: numerics        !! tolerances
    type(hybrid_state_t), intent(inout) :: state    !! state
    type(segment_t), intent(inout) :: segment       !! what happened
    real(wp), intent(in) :: z(max_states)           !! local coordinates
    logical, intent(out) :: resolved                !! whether the stretch ended here
    real(wp) :: distance, approach
    integer :: flank
    resolved = .false.
    do flank = 1, system%n_flanks
      call system%contact(segment%frame, flank, 0.0_wp, z, distance, approach)
      if (flank == state%instant%touching) then
        if (system%sums_chatter(flank) .and. .not. system%compliant) then
          call sum_chatter(system, numerics, state, segment, z, flank, -approach, resolved)
        end if
        if (resolved) return
      else if (distance <= 0) then
        if (approach > 0 .or. (.not. approach < 0 &
            .and. pressing_sign(system, segment%frame, flank, 0.0_wp, z) > 0)) then
          call strike(system, state, segment, segment%frame, flank, 0.0_wp, z)
          resolved = .true.
          return
        end if
        state%instant%touching = flank
      end if
    end do
  end subroutine meet_flanks

  !> In contact at the beginning of a stretch: let go a tooth that stands at zero and leaves.
  subroutine keep_contact(system, state, segment, z, resolved)
    class(system_t), intent(in) :: system           !! what moves
    type(hybrid_state_t), intent(inout) :: state    !! state
    type(segment_t), intent(inout) :: segment       !! what happened
    real(wp), intent(in) :: z(max_states)           !! local coordinates
    logical, intent(out) :: resolved                !! whether the stretch ended here
    real(wp) :: distance, approach
    integer :: flank
    resolved = .false.
    flank = segment%motion_state
    if (state%instant%touching == flank) return
    call system%contact(segment%frame, flank, 0.0_wp, z, distance, approach)
    if (distance < 0) return
    if (approach < 0 .or. (.not. approach > 0 &
        .and. pressing_sign(system, segment%frame, flank, 0.0_wp, z) < 0)) then
      call let_go(system, state, segment, flank, approach)
      resolved = .true.
    else
      state%instant%touching = flank
    end if
  end subroutine keep_contact

  !> End a chatter whose rest is short and regular enough to be summed.
  subroutine sum_chatter(system, numerics, state, segment, z, flank, speed, resolved)
    class(system_t), intent(in) :: system           !! what moves
    type(numerics_t), intent(in) :: numerics        !! tolerances
    type(hybrid_state_t), intent(inout) :: state    !! state
    type(segment_t), intent(inout) :: segment       !! what happened
    real(wp), intent(in) :: z(max_states)           !! local coordinates at the beginning
    integer, intent(in) :: flank                    !! flank being bounced on
    real(wp), intent(in) :: speed                   !! speed after the last impact
    logical, intent(out) :: resolved                !! whether the chatter ended
    real(wp) :: pressing(0:max_degree), duration, z_end(max_states)
    call system%pressing(segment%frame, flank, 0.0_wp, z, pressing)
    call remaining_chatter(pressing, speed, system%restitution, system%period, &
        numerics%chatter_tolerance, segment%frame%piece_end, resolved, duration)
    if (.not. resolved) return
    ! Whatever else the system has moves on as in contact; the tooth itself ends on the flank.
    call rk4_move(system, segment%frame, flank, duration, z, z_end)
    call system%commit(segment%frame, duration, z_end, flank, state%instant%y)
    segment%length = duration
    state%instant%t = state%instant%t + duration
    call begin_contact(system, state, segment, event_chatter_end, flank, 0.0_wp)
  end subroutine sum_chatter

  !> Rigid contact: on the flank until it would have to pull, or to the next kink or cycle.
  subroutine follow(system, state, segment, z)
    class(system_t), intent(in) :: system           !! what moves
    type(hybrid_state_t), intent(inout) :: state    !! state
    type(segment_t), intent(inout) :: segment       !! what happened
    real(wp), intent(in) :: z(max_states)           !! local coordinates at the beginning
    type(crossing_t) :: at
    real(wp) :: pressing(0:max_degree), s
    logical :: answered
    integer :: flank
    flank = segment%motion_state
    at%frame = segment%frame
    call system%rigid_release(state%instant, at%frame%stop, answered, at%found, s)
    do while (.not. answered)
      call system%pressing(at%frame, flank, at%frame%piece_begin, z, pressing)
      call first_descent(pressing, at%frame%piece_end - at%frame%piece_begin, .true., at%found, s)
      if (at%found) exit
      if (at%frame%piece_end >= at%frame%stop) exit
      call system%next_piece(at%frame)
      call system%pressing(at%frame, flank, at%frame%piece_begin, z, pressing)
      if (pressing(0) < 0) then
        at%found = .true.
        s = 0
        exit
      end if
    end do
    if (at%found) at%found = .not. at_stop(segment%frame, at%frame%piece_begin + s)
    if (at%found) then
      segment%length = at%frame%piece_begin + s
      call move_time(state, segment)
      call let_go(system, state, segment, flank, 0.0_wp)
    else
      segment%length = at%frame%stop
      call pass_stop(system, state, segment)
    end if
  end subroutine follow

  !> One accepted step, cut at the first event in it.
  subroutine step_on(system, numerics, state, segment, z, work, status)
    class(system_t), intent(in) :: system           !! what moves
    type(numerics_t), intent(in) :: numerics        !! tolerances
    type(hybrid_state_t), intent(inout) :: state    !! state
    type(segment_t), intent(inout) :: segment       !! what happened
    real(wp), intent(in) :: z(max_states)           !! local coordinates at the beginning
    type(work_t), intent(inout) :: work             !! counts
    integer, intent(out) :: status                  !! status_*
    type(crossing_t) :: crossing
    real(wp) :: z_end(max_states), z_event(max_states)
    logical :: stays
    segment%stepped = .true.
    call accept_step(system, numerics, state, segment, z, z_end, work, status)
    if (status /= status_ok) return
    if (segment%motion_state /= separation) then
      call system%stay(segment%frame, segment%motion, z_end, state%instant, stays)
      if (stays) then
        call end_of_step(system, state, segment)
        return
      end if
    end if
    call find_crossing(system, segment%frame, segment%motion_state, state%instant%touching, &
        segment%motion, work, crossing)
    if (crossing%found) then
      call polish_crossing(system, segment%frame, segment%motion_state, segment%motion%h, z, &
          crossing, z_event, work)
      if (at_stop(segment%frame, crossing%s)) then
        crossing%found = .false.
        do while (crossing%frame%piece_end < segment%motion%h)
          call system%next_piece(crossing%frame)
        end do
      end if
    end if
    if (crossing%found) then
      call end_at_crossing(system, state, segment, crossing, z_event)
    else
      call system%commit(crossing%frame, segment%motion%h, z_end, state%instant%chart, &
          state%instant%y)
      state%instant%piece = crossing%frame%piece
      call end_of_step(system, state, segment)
    end if
  end subroutine step_on

  !> A step has been taken to its end, where the state is already but for its time.
  subroutine end_of_step(system, state, segment)
    class(system_t), intent(in) :: system           !! what moves
    type(hybrid_state_t), intent(inout) :: state    !! state
    type(segment_t), intent(inout) :: segment       !! what happened
    segment%length = segment%motion%h
    if (segment%length >= segment%frame%stop) then
      call pass_stop(system, state, segment)
    else
      call move_time(state, segment)
    end if
  end subroutine end_of_step

  !> One stretch in closed form, to the first event or the stop.
  subroutine stretch_on(system, state, segment, work)
    class(system_t), intent(in) :: system           !! what moves
    type(hybrid_state_t), intent(inout) :: state    !! state
    type(segment_t), intent(inout) :: segment       !! what happened
    type(work_t), intent(inout) :: work             !! counts
    type(reached_t) :: reached
    type(frame_t) :: frame
    real(wp) :: z(max_states), distance, approach
    work%stretches = work%stretches + 1
    segment%closed = .true.
    segment%begin = state%instant
    call system%stretch(state%instant, segment%frame%stop, reached)
    segment%length = reached%s
    state%instant%chart = reached%chart
    state%instant%y = reached%y
    if (reached%flank == no_flank .and. reached%s < segment%frame%stop) then
      call move_time(state, segment)
      return
    end if
    if (reached%flank == no_flank .or. at_stop(segment%frame, reached%s)) then
      segment%length = segment%frame%stop
      call pass_stop(system, state, segment)
      return
    end if
    call move_time(state, segment)
    call system%open_frame(state%instant, frame, z)
    if (segment%motion_state == separation) then
      call strike(system, state, segment, frame, reached%flank, 0.0_wp, z)
    else
      call system%contact(frame, reached%flank, 0.0_wp, z, distance, approach)
      call leave_or_stay(system, state, segment, reached%flank, approach)
    end if
  end subroutine stretch_on

  !> Equal times, to the resolution of time: what happens at the stop, a kink or the end of the
  !> cycle, comes before an event at a flank.
  pure logical function at_stop(frame, s)
    type(frame_t), intent(in) :: frame   !! frame as opened
    real(wp), intent(in) :: s            !! time of the event since then
    real(wp) :: ends
    ends = frame%t + frame%stop
    ! `spacing` is slow, and most events are nowhere near.
    at_stop = frame%t + s >= ends*(1 - 2*epsilon(s))
    if (at_stop) at_stop = frame%t + s >= ends - spacing(ends)
  end function at_stop

  !> Try steps until the error estimate is within the tolerance.
  subroutine accept_step(system, numerics, state, segment, z, z_end, work, status)
    class(system_t), intent(in) :: system           !! what moves
    type(numerics_t), intent(in) :: numerics        !! tolerances
    type(hybrid_state_t), intent(inout) :: state    !! state: its step memory is updated
    type(segment_t), intent(inout) :: segment       !! its motion is set
    real(wp), intent(in) :: z(max_states)           !! local coordinates at the beginning
    real(wp), intent(out) :: z_end(max_states)      !! and at the end
    type(work_t), intent(inout) :: work             !! counts
    integer, intent(out) :: status                  !! status_*
    real(wp) :: error(max_states), scale(max_states), ratio, h
    logical :: cut_short
    integer :: n
    n = system%n_states
    status = status_ok
    call system%scales(segment%motion_state, scale)
    associate (memory => state%memory(segment%motion_state))
      h = step_to_try(memory, segment%motion_state /= separation, numerics%tolerance)
      cut_short = segment%frame%stop < h
      h = min(h, segment%frame%stop)
      do
        call rk4_step(system, segment%frame, segment%motion_state, h, z, segment%motion, &
            z_end, error)
        if (segment%motion_state == separation) then
          ratio = error_ratio(error(1:n), scale(1:n), numerics%tolerance)
        else
          ratio = ratio_in_contact(h, z(1:n), error(1:n), scale(1:n), numerics%tolerance)
        end if
        if (ratio <= 1) exit
        work%rejected = work%rejected + 1
        cut_short = .false.
        if (.not. ratio <= huge(ratio)) then
          h = 0.1_wp*h
        else
          h = after_rejected(h, ratio)
        end if
        if (h <= spacing(system%period)) then
          status = merge(status_step_too_small, status_not_finite, abs(sum(z(1:n))) <= huge(h))
          return
        end if
      end do
      call after_accepted(memory, h, ratio, cut_short)
    end associate
    work%steps = work%steps + 1
  end subroutine accept_step

  !> The stretch ends at a flank: an impact or a contact from separation, a release from contact.
  subroutine end_at_crossing(system, state, segment, crossing, z_event)
    class(system_t), intent(in) :: system           !! what moves
    type(hybrid_state_t), intent(inout) :: state    !! state
    type(segment_t), intent(inout) :: segment       !! what happened
    type(crossing_t), intent(in) :: crossing        !! where
    real(wp), intent(in) :: z_event(max_states)     !! local coordinates there
    real(wp) :: distance, approach
    segment%length = crossing%s
    call move_time(state, segment)
    state%instant%piece = crossing%frame%piece
    if (segment%motion_state == separation) then
      call strike(system, state, segment, crossing%frame, crossing%flank, crossing%s, z_event)
    else
      call system%contact(crossing%frame, crossing%flank, crossing%s, z_event, distance, approach)
      call system%commit(crossing%frame, crossing%s, z_event, crossing%flank, state%instant%y)
      call leave_or_stay(system, state, segment, crossing%flank, approach)
    end if
  end subroutine end_at_crossing

  !> A contact has come to zero: release, or, where it was only grazed from inside, the tooth stays.
  subroutine leave_or_stay(system, state, segment, flank, approach)
    class(system_t), intent(in) :: system           !! what moves
    type(hybrid_state_t), intent(inout) :: state    !! state
    type(segment_t), intent(inout) :: segment       !! what happened
    integer, intent(in) :: flank                    !! flank in contact
    real(wp), intent(in) :: approach                !! approach velocity
    if (approach < 0) then
      call let_go(system, state, segment, flank, approach)
    else
      call system%launch(flank, approach, state%instant%y)
      state%instant%touching = flank
    end if
  end subroutine leave_or_stay

  !> Time at the end of a stretch that ends between two knots.
  pure subroutine move_time(state, segment)
    type(hybrid_state_t), intent(inout) :: state    !! state
    type(segment_t), intent(in) :: segment          !! stretch
    state%instant%t = segment%t + segment%length
    state%instant%touching = 0
  end subroutine move_time

  !> The stretch ends at a stop: go past the knot; a kink changes the velocity relative to a
  !> moving flank, and in rigid contact it strikes the tooth or throws it off.
  subroutine pass_stop(system, state, segment)
    class(system_t), intent(in) :: system           !! what moves
    type(hybrid_state_t), intent(inout) :: state    !! state
    type(segment_t), intent(inout) :: segment       !! what happened
    logical :: is_kink
    real(wp) :: jump, phi, phi_dot
    integer :: cycle_before
    cycle_before = state%instant%cycle
    state%instant%touching = 0
    call system%pass_knot(segment%frame%stop_knot, state%instant, is_kink, jump)
    segment%cycle_completed = state%instant%cycle /= cycle_before
    if (segment%cycle_completed) then
      state%events_in_cycle = 0
      state%steps_in_cycle = 0
      ! A cycle then depends on the state it begins with and on nothing else, so that the cycles of
      ! a periodic motion are the same bytes. The step is found again in a few trials.
      state%memory = step_memory_t()
    end if
    if (.not. is_kink) then
      if (system%rigid .and. segment%motion_state /= separation) then
        call system%launch(segment%motion_state, 0.0_wp, state%instant%y)
      end if
      return
    end if
    call system%observe(state%instant, phi, phi_dot)
    call log_event(system, state, segment, event_kink, drive_flank, phi_dot - jump, phi_dot)
    if (system%rigid .and. segment%motion_state /= separation) then
      call strike_resting(system, state, segment)
    end if
  end subroutine pass_stop

  !> Named ends of everything that physics could make endless.
  subroutine check_bounds(system, numerics, state, segment, status)
    class(system_t), intent(in) :: system           !! what moves
    type(numerics_t), intent(in) :: numerics        !! bounds
    type(hybrid_state_t), intent(inout) :: state    !! state
    type(segment_t), intent(in) :: segment          !! what happened
    integer, intent(out) :: status                  !! status_*
    status = status_ok
    state%events_in_cycle = state%events_in_cycle + segment%n_events
    state%steps_in_cycle = state%steps_in_cycle + 1
    if (state%events_in_cycle > numerics%max_events_per_cycle) status = status_too_many_events
    if (state%steps_in_cycle > numerics%max_steps_per_cycle) status = status_too_many_steps
    if (.not. abs(sum(state%instant%y(1:system%n_states))) <= huge(1.0_wp)) then
      status = status_not_finite
    end if
  end subroutine check_bounds
end module lapwing_hybrid_automaton
