!> The hybrid automaton: one call advances the state by one arc and resolves whatever ends it.
!> Serves any system and any flow. Corners are decided as docs/model.md says.
module lapwing_hybrid_automaton
  use lapwing_kinds, only: wp
  use lapwing_codes, only: separation, no_flank, drive_flank, event_kink, event_chatter_end, &
      status_ok, status_too_many_events, status_too_many_steps, status_not_finite
  use lapwing_flow, only: flow_t, reached_t, work_t, step_memory_t, at_stop
  use lapwing_flow_rk4_step, only: rk4_move
  use lapwing_hybrid_chatter, only: remaining_chatter, listed_down_to, summed_up_to
  use lapwing_hybrid_impact, only: arrive, pass_kink_in_contact, begin_contact, release, &
      pressing_sign, log_event
  use lapwing_hybrid_state, only: hybrid_state_t, numerics_t, segment_t
  use lapwing_polynomial_evaluation, only: max_degree
  use lapwing_polynomial_roots, only: first_descent
  use lapwing_system, only: system_t, frame_t, approach_velocity, max_states
  implicit none
  private
  public :: advance

  !> Steps of which nobody hears, at most, in one call: the clock is looked at in between.
  integer, parameter :: most_skipped = 255

contains

  !> Advance by one arc, or by none where the tooth stands at an event.
  subroutine advance(system, flow, numerics, state, segment, work, status)
    class(system_t), intent(in) :: system           !! what moves
    class(flow_t), intent(in) :: flow               !! how it moves along an arc
    type(numerics_t), intent(in) :: numerics        !! tolerances and bounds
    type(hybrid_state_t), intent(inout) :: state    !! state, moved on
    type(segment_t), intent(inout) :: segment       !! what happened
    type(work_t), intent(inout) :: work             !! counts
    integer, intent(out) :: status                  !! status_*
    logical :: clear, rigid, resolved
    status = status_ok
    rigid = .false.
    resolved = .false.
    segment%begin = state%instant
    segment%length = 0
    segment%moves = .false.
    segment%skipped = 0
    segment%n_events = 0
    segment%cycle_completed = .false.
    clear = system%begins_clear(state%instant, &
        merge(summed_up_to, listed_down_to, numerics%sum_early)*system%period)
    if (flow%takes_steps .or. .not. clear) call flow%open(system, state%instant, segment%frame)
    if (.not. clear) then
      call system%complete_frame(segment%frame)
      if (state%instant%motion_state == separation) then
        call meet_flanks(system, numerics, state, segment, resolved)
      else
        rigid = system%law%is_rigid()
        call keep_contact(system, state, segment, resolved)
      end if
      segment%begin%touching = state%instant%touching
    end if
    if (.not. resolved) then
      if (rigid) then
        call follow(system, flow, state, segment)
      else
        call move_on(system, flow, numerics, .not. clear, state, segment, work, status)
      end if
    end if
    if (status == status_ok) call check_bounds(system, numerics, segment, state, status)
  end subroutine advance

  !> In separation at the beginning of an arc: arrive at a flank that is met already, sum a
  !> chatter that has become short, or know which flank is being left.
  subroutine meet_flanks(system, numerics, state, segment, resolved)
    class(system_t), intent(in) :: system           !! what moves
    type(numerics_t), intent(in) :: numerics        !! tolerances
    type(hybrid_state_t), intent(inout) :: state
    type(segment_t), intent(inout) :: segment       !! what happened
    logical, intent(out) :: resolved                !! whether the arc ended here
    real(wp) :: distance, approach
    integer :: flank
    resolved = .false.
    do flank = 1, system%n_flanks
      call system%contact(segment%frame, flank, 0.0_wp, state%instant%y, distance, approach)
      if (flank == state%instant%touching) then
        if (system%law%sums_chatter(system%moves(flank))) then
          call sum_chatter(system, numerics, state, segment, flank, -approach, resolved)
        end if
        if (resolved) return
      else if (distance <= 0) then
        if (approach > 0 .or. (.not. approach < 0 &
            .and. pressing_sign(system, segment%frame, flank, 0.0_wp, state%instant%y) > 0)) then
          call system%commit(segment%frame, 0.0_wp, segment%begin%y, flank, state%instant%y)
          call arrive(system, state, segment, flank, &
              system%flank_velocity(segment%frame, flank, 0.0_wp))
          resolved = .true.
          return
        end if
        state%instant%touching = flank
      end if
    end do
  end subroutine meet_flanks

  !> In contact at the beginning of an arc: release a tooth that stands at zero and leaves.
  subroutine keep_contact(system, state, segment, resolved)
    class(system_t), intent(in) :: system           !! what moves
    type(hybrid_state_t), intent(inout) :: state
    type(segment_t), intent(inout) :: segment       !! what happened
    logical, intent(out) :: resolved                !! whether the arc ended here
    real(wp) :: distance, approach
    integer :: flank
    resolved = .false.
    flank = state%instant%motion_state
    if (state%instant%touching == flank) return
    call system%contact(segment%frame, flank, 0.0_wp, state%instant%y, distance, approach)
    if (distance < 0) return
    if (approach < 0 .or. (.not. approach > 0 &
        .and. pressing_sign(system, segment%frame, flank, 0.0_wp, state%instant%y) < 0)) then
      call release(system, state, segment, flank, approach)
      resolved = .true.
    else
      state%instant%touching = flank
    end if
  end subroutine keep_contact

  !> End a chatter whose rest is short and regular enough to be summed.
  subroutine sum_chatter(system, numerics, state, segment, flank, speed, resolved)
    class(system_t), intent(in) :: system           !! what moves
    type(numerics_t), intent(in) :: numerics        !! tolerances
    type(hybrid_state_t), intent(inout) :: state
    type(segment_t), intent(inout) :: segment       !! what happened
    integer, intent(in) :: flank                    !! flank being bounced on
    real(wp), intent(in) :: speed                   !! speed after the last impact
    logical, intent(out) :: resolved                !! whether the chatter ended
    real(wp) :: pressing(0:max_degree), longest, duration, z_end(max_states)
    call system%pressing(segment%frame, flank, 0.0_wp, state%instant%y, pressing)
    longest = listed_down_to
    if (numerics%sum_early .and. flank == drive_flank) then
      if (is_uncounted(state, speed, pressing(0), system%strongest, numerics%count_depth)) then
        longest = summed_up_to
      end if
    end if
    call remaining_chatter(pressing, speed, system%law%restitution, system%period, longest, &
        numerics%chatter_tolerance, segment%frame%piece_end, resolved, duration)
    if (.not. resolved) return
    ! Whatever else the system has moves on as in contact; the tooth itself ends on the flank.
    call rk4_move(system, segment%frame, flank, duration, segment%begin%y, z_end)
    call system%commit(segment%frame, duration, z_end, flank, state%instant%y)
    segment%length = duration
    state%instant%t = state%instant%t + duration
    call begin_contact(system, state, segment, event_chatter_end, flank, 0.0_wp)
  end subroutine sum_chatter

  !> Whether a bounce is certainly too shallow to count, and all that follow it.
  !>
  !> It goes as deep as v**2/(2a), or hardly more: over a chatter that may be summed, a is all but
  !> constant; twice that is allowed for. A flight of this cycle with rebound speed w went at least
  !> as deep as w**2 over twice the strongest pressing acceleration.
  pure logical function is_uncounted(state, speed, pressing, strongest, count_depth)
    type(hybrid_state_t), intent(in) :: state       !! it knows w
    real(wp), intent(in) :: speed                   !! v, rebound speed
    real(wp), intent(in) :: pressing                !! a, pressing acceleration
    real(wp), intent(in) :: strongest               !! bound of it
    real(wp), intent(in) :: count_depth             !! least depth that counts, part of the deepest
    is_uncounted = 2*speed**2 <= count_depth*(pressing/strongest)*state%fastest**2
  end function is_uncounted

  !> Rigid contact: on the flank until it would have to pull, or to the next kink or cycle.
  subroutine follow(system, flow, state, segment)
    class(system_t), intent(in) :: system           !! what moves
    class(flow_t), intent(in) :: flow               !! may know when the tooth would be pulled
    type(hybrid_state_t), intent(inout) :: state
    type(segment_t), intent(inout) :: segment       !! what happened
    type(frame_t) :: frame
    real(wp) :: pressing(0:max_degree), s
    logical :: known, found
    integer :: flank
    flank = state%instant%motion_state
    frame = segment%frame
    call flow%rigid_release(system, state%instant, frame%stop, known, found, s)
    do while (.not. known)
      call system%pressing(frame, flank, frame%piece_begin, segment%begin%y, pressing)
      call first_descent(pressing, frame%piece_end - frame%piece_begin, .true., found, s)
      if (found) exit
      if (frame%piece_end >= frame%stop) exit
      call system%next_piece(frame)
      call system%pressing(frame, flank, frame%piece_begin, segment%begin%y, pressing)
      if (pressing(0) < 0) then
        found = .true.
        s = 0
        exit
      end if
    end do
    if (found) found = .not. at_stop(segment%frame, frame%piece_begin + s)
    if (found) then
      segment%length = frame%piece_begin + s
      call move_time(state, segment)
      call release(system, state, segment, flank, 0.0_wp)
    else
      segment%length = frame%stop
      call pass_stop(system, state, segment)
    end if
  end subroutine follow

  !> Follow the flow, to the first event or the stop.
  subroutine move_on(system, flow, numerics, opened, state, segment, work, status)
    class(system_t), intent(in) :: system           !! what moves
    class(flow_t), intent(in) :: flow               !! how
    type(numerics_t), intent(in) :: numerics        !! tolerance
    logical, intent(in) :: opened                   !! whether the arc's frame is
    type(hybrid_state_t), intent(inout) :: state
    type(segment_t), intent(inout) :: segment       !! what happened
    type(work_t), intent(inout) :: work             !! counts
    integer, intent(out) :: status                  !! status_*
    type(reached_t) :: reached
    reached%flank_velocity = 0
    segment%may_skip = 0
    if (segment%unseen) segment%may_skip = min(most_skipped, &
        numerics%max_steps_per_cycle - state%steps_in_cycle - 1)
    call flow%advance(system, numerics%tolerance, opened, segment%arc_t, state%memory, reached, &
        work, status)
    if (status /= status_ok) return
    segment%moves = .true.
    segment%length = reached%s
    state%instant%chart = reached%chart
    state%instant%piece = reached%piece
    state%instant%y(1:2) = reached%y(1:2)
    if (system%n_states > 2) state%instant%y(3:system%n_states) = reached%y(3:system%n_states)
    if (reached%flank == no_flank .and. reached%s >= segment%frame%stop) then
      call pass_stop(system, state, segment)
      return
    end if
    call move_time(state, segment)
    if (reached%flank == no_flank) return
    if (state%instant%motion_state == separation) then
      call arrive(system, state, segment, reached%flank, reached%flank_velocity)
    else
      call leave_or_stay(system, state, segment, reached%flank, &
          approach_velocity(reached%flank, state%instant%y))
    end if
  end subroutine move_on

  !> A contact has come to zero: release, or, where it was only grazed from inside, the tooth stays.
  subroutine leave_or_stay(system, state, segment, flank, approach)
    class(system_t), intent(in) :: system           !! what moves
    type(hybrid_state_t), intent(inout) :: state
    type(segment_t), intent(inout) :: segment       !! what happened
    integer, intent(in) :: flank                    !! flank in contact
    real(wp), intent(in) :: approach                !! approach velocity
    if (approach < 0) then
      call release(system, state, segment, flank, approach)
    else
      call system%place_at_flank(flank, approach, state%instant%y)
      state%instant%touching = flank
    end if
  end subroutine leave_or_stay

  !> Time at the end of an arc that ends between two knots.
  pure subroutine move_time(state, segment)
    type(hybrid_state_t), intent(inout) :: state
    type(segment_t), intent(in) :: segment          !! arc
    state%instant%t = segment%begin%t + segment%length
    state%instant%touching = 0
  end subroutine move_time

  !> The arc ends at a stop: go past the knot; a kink changes the velocity relative to a
  !> moving flank; in rigid contact it is an impact or a release.
  subroutine pass_stop(system, state, segment)
    class(system_t), intent(in) :: system           !! what moves
    type(hybrid_state_t), intent(inout) :: state
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
      state%leaving = 0
      state%fastest = 0
      ! A cycle then depends on the state it begins with and on nothing else, so that the cycles of
      ! a periodic motion are the same bytes. The step is found again in a few trials.
      state%memory = step_memory_t()
    end if
    if (.not. is_kink) then
      if (in_rigid_contact(system, state)) then
        call system%place_at_flank(state%instant%motion_state, 0.0_wp, state%instant%y)
      end if
      return
    end if
    state%leaving = 0
    call system%observe(state%instant, phi, phi_dot)
    call log_event(system, state, segment, event_kink, drive_flank, phi_dot - jump, phi_dot)
    if (in_rigid_contact(system, state)) then
      call pass_kink_in_contact(system, state, segment)
    end if
  end subroutine pass_stop

  !> Whether the tooth follows a flank that does not yield.
  pure logical function in_rigid_contact(system, state) result(rigid)
    class(system_t), intent(in) :: system           !! what moves
    type(hybrid_state_t), intent(in) :: state
    rigid = state%instant%motion_state /= separation
    if (rigid) rigid = system%law%is_rigid()
  end function in_rigid_contact

  !> Named ends of everything that physics could make endless.
  subroutine check_bounds(system, numerics, segment, state, status)
    class(system_t), intent(in) :: system           !! what moves
    type(numerics_t), intent(in) :: numerics        !! bounds
    type(segment_t), intent(in) :: segment          !! what happened
    type(hybrid_state_t), intent(inout) :: state
    integer, intent(out) :: status                  !! status_*
    real(wp) :: total
    status = status_ok
    state%events_in_cycle = state%events_in_cycle + segment%n_events
    state%steps_in_cycle = state%steps_in_cycle + segment%skipped + 1
    if (state%events_in_cycle > numerics%max_events_per_cycle) status = status_too_many_events
    if (state%steps_in_cycle > numerics%max_steps_per_cycle) status = status_too_many_steps
    total = state%instant%y(1) + state%instant%y(2)
    if (system%n_states > 2) total = total + sum(state%instant%y(3:system%n_states))
    if (.not. abs(total) <= huge(total)) status = status_not_finite
  end subroutine check_bounds
end module lapwing_hybrid_automaton
