!> The automaton's common cases for a motion in closed form: a flight or a contact that begins and
!> ends as most do. It does what `lapwing_hybrid_automaton` does, with the same procedures and to
!> the same bit, but opens no frames; whatever is special it leaves untouched to the automaton.
module lapwing_hybrid_exact_automaton
  use lapwing_kinds, only: wp
  use lapwing_hybrid_automaton, only: at_stop, pass_stop
  use lapwing_hybrid_chatter, only: listed_down_to
  use lapwing_codes, only: separation, no_flank, drive_flank, event_impact, event_engage
  use lapwing_hybrid_impact, only: begin_contact, let_go, log_event
  use lapwing_flow_exact_exact_oscillator, only: exact_oscillator_t, begin_curve, walls
  use lapwing_flow_exact_contact, only: contact_end
  use lapwing_flow_exact_flight, only: end_t, flight_end
  use lapwing_hybrid_state, only: hybrid_state_t, segment_t
  use lapwing_system_oscillator, only: impact_law
  use lapwing_polynomial_evaluation, only: max_degree
  use lapwing_flow_exact_motion, only: curve_t, expand_launch, flank_taylor
  use lapwing_flank_table, only: locate_piece
  implicit none
  private
  public :: advance_plainly

contains

  !> One stretch, if it is a plain one; otherwise the state is as it was.
  subroutine advance_plainly(self, state, segment, done)
    type(exact_oscillator_t), intent(in) :: self    !! what moves
    type(hybrid_state_t), intent(inout) :: state    !! state
    type(segment_t), intent(inout) :: segment       !! what happened
    logical, intent(out) :: done                    !! whether it was
    done = .false.
    if (self%rigid .or. (self%n_flanks == 2 .and. .not. self%coast_moves)) return
    associate (instant => state%instant)
      if (self%scene%form%graded .and. instant%motion_state /= separation) return
      if (.not. begins_plainly(self, instant%motion_state, instant%touching, instant%chart, &
          instant%y)) return
      segment%motion_state = instant%motion_state
      segment%cycle = instant%cycle
      segment%t = instant%t
      segment%stepped = .false.
      segment%closed = .true.
      segment%begin = instant
      segment%n_events = 0
      segment%cycle_completed = .false.
      if (.not. self%scene%form%harmonic) then
        segment%begin%piece = locate_piece(self%table, instant%t, instant%piece)
        segment%frame%stop_knot = self%table%next_kink(segment%begin%piece)
        segment%frame%stop = self%table%knot(segment%frame%stop_knot) - instant%t
      else
        segment%begin%piece = 1
        segment%frame%stop_knot = self%table%n + 1
        segment%frame%stop = self%period - instant%t
      end if
      segment%frame%piece = segment%begin%piece
      segment%frame%chart = instant%chart
      segment%frame%t = instant%t
    end associate
    if (segment%motion_state == separation) then
      call fly(self, state, segment, done)
    else
      call stay_in_contact(self, state, segment, done)
    end if
  end subroutine advance_plainly

  !> Whether a stretch begins between the flanks, or leaves one with a speed; in contact, inside
  !> the flank or on the way into it.
  pure logical function begins_plainly(self, motion_state, touching, chart, y)
    type(exact_oscillator_t), intent(in) :: self    !! what moves
    integer, intent(in) :: motion_state             !! motion state
    integer, intent(in) :: touching                 !! flank touched
    integer, intent(in) :: chart                    !! flank that y refers to
    real(wp), intent(in) :: y(:)                    !! position and velocity
    real(wp) :: wall(2), inward
    inward = merge(1.0_wp, -1.0_wp, chart == drive_flank)
    if (motion_state /= separation) then
      begins_plainly = touching == chart .or. inward*y(1) > 0
    else if (touching /= no_flank) then
      begins_plainly = touching == chart .and. inward*y(2) < 0
    else
      wall = walls(self, chart)
      begins_plainly = y(1) < wall(1) .and. y(1) > wall(2)
    end if
  end function begins_plainly

  !> A flight, and the impact or the contact that it ends with.
  subroutine fly(self, state, segment, done)
    type(exact_oscillator_t), intent(in) :: self    !! what moves
    type(hybrid_state_t), intent(inout) :: state    !! state
    type(segment_t), intent(inout) :: segment       !! what happened
    logical, intent(out) :: done                    !! whether it was a plain one
    type(curve_t) :: curve
    type(end_t) :: at
    real(wp) :: before, after
    done = .false.
    call begin_curve(self, segment%begin, curve)
    call expand_launch(self%scene, curve)
    if (segment%begin%touching /= no_flank) then
      if (may_end_chatter(self, segment%begin%touching, curve)) return
    end if
    call flight_end(self%scene, curve, walls(self, segment%begin%chart), &
        segment%begin%touching, segment%frame%stop, at)
    if (at%flank == no_flank) then
      call reach_stop(self, state, segment, at)
      done = .true.
      return
    end if
    if (at_stop(segment%frame, at%s)) return
    before = merge(at%v, -at%v, at%flank == drive_flank)
    if (before <= 0) return
    if (self%compliant) then
      call arrive(state, segment, at)
      call begin_contact(self, state, segment, event_engage, at%flank, before)
    else
      after = rebound_at(self, segment%t + at%s, segment%begin%piece, at%flank, before)
      ! Slower than this it might have to be told to rest.
      if (after == 0 .or. abs(after) <= self%slow) return
      call arrive(state, segment, at)
      call self%launch(at%flank, after, state%instant%y)
      call log_event(self, state, segment, event_impact, at%flank, before, after)
      if (after > 0) call begin_contact(self, state, segment, event_engage, at%flank, after)
    end if
    done = .true.
  end subroutine fly

  !> Whether what follows might be the end of a chatter.
  pure logical function may_end_chatter(self, flank, curve)
    type(exact_oscillator_t), intent(in) :: self    !! what moves
    integer, intent(in) :: flank                    !! flank left
    type(curve_t), intent(in) :: curve              !! the flight
    real(wp) :: push
    may_end_chatter = .false.
    if (self%compliant .or. self%absolute) return
    push = merge(2*curve%taylor(2), -2*curve%taylor(2), flank == drive_flank)
    may_end_chatter = push > 0 .and. 2*abs(curve%v) &
        <= 2*listed_down_to*self%period*push*(1 - self%restitution)
  end function may_end_chatter

  !> Approach velocity after an impact; see `rebound`.
  pure real(wp) function rebound_at(self, t, guess, flank, approach) result(after)
    type(exact_oscillator_t), intent(in) :: self    !! what moves
    real(wp), intent(in) :: t                       !! time in the cycle
    integer, intent(in) :: guess                    !! table piece to look at first
    integer, intent(in) :: flank                    !! flank struck
    real(wp), intent(in) :: approach                !! approach velocity before
    real(wp) :: g(0:max_degree)
    integer :: piece
    g = 0
    if (self%absolute) then
      piece = 1
      if (.not. self%scene%form%harmonic) piece = locate_piece(self%table, t, guess)
      call flank_taylor(self%scene, .true., t, piece, g)
    end if
    after = impact_law(self, flank, g(1), approach)
  end function rebound_at

  !> A contact, and the release that it ends with.
  subroutine stay_in_contact(self, state, segment, done)
    type(exact_oscillator_t), intent(in) :: self    !! what moves
    type(hybrid_state_t), intent(inout) :: state    !! state
    type(segment_t), intent(inout) :: segment       !! what happened
    logical, intent(out) :: done                    !! whether it was a plain one
    type(curve_t) :: curve
    type(end_t) :: at
    real(wp) :: approach
    integer :: flank
    done = .false.
    flank = segment%motion_state
    call begin_curve(self, segment%begin, curve)
    call contact_end(self%scene, curve, flank, segment%begin%touching == flank, &
        segment%frame%stop, at)
    if (at%flank == no_flank) then
      call reach_stop(self, state, segment, at)
      done = .true.
      return
    end if
    if (at_stop(segment%frame, at%s)) return
    approach = merge(at%v, -at%v, flank == drive_flank)
    if (approach >= 0) return
    call arrive(state, segment, at)
    call let_go(self, state, segment, flank, approach)
    done = .true.
  end subroutine stay_in_contact

  !> The stretch has lasted until the next kink or the end of the cycle.
  subroutine reach_stop(self, state, segment, at)
    type(exact_oscillator_t), intent(in) :: self    !! what moves
    type(hybrid_state_t), intent(inout) :: state    !! state
    type(segment_t), intent(inout) :: segment       !! what happened
    type(end_t), intent(in) :: at                   !! its end
    segment%length = segment%frame%stop
    state%instant%y(1:2) = [at%x, at%v]
    call pass_stop(self, state, segment)
  end subroutine reach_stop

  !> The stretch has ended at a flank.
  pure subroutine arrive(state, segment, at)
    type(hybrid_state_t), intent(inout) :: state    !! state
    type(segment_t), intent(inout) :: segment       !! what happened
    type(end_t), intent(in) :: at                   !! its end
    segment%length = at%s
    state%instant%t = segment%t + at%s
    state%instant%chart = at%flank
    state%instant%touching = at%flank
    state%instant%piece = segment%begin%piece
  end subroutine arrive
end module lapwing_hybrid_exact_automaton
