!> The automaton on systems of one degree of freedom whose motion is known by hand.
program test_automaton
  use assertions, only: tally_t
  use lapwing_flow_rk4_rk4_flow, only: rk4_flow_t
  use lapwing_hybrid_automaton, only: advance
  use lapwing_codes, only: separation, engagement, coast_flank, event_impact, event_chatter_end, &
      event_engage, event_kind, status_ok, status_too_many_events, status_too_many_steps, &
      status_not_finite
  use lapwing_contact_impact, only: relative_impact_t
  use lapwing_contact_rigid, only: rigid_t
  use lapwing_flow, only: work_t
  use lapwing_hybrid_state, only: hybrid_state_t, numerics_t, segment_t, event_t
  use lapwing_kinds, only: wp
  use lapwing_system_oscillator, only: oscillator_t
  use test_systems, only: oscillator
  use lapwing_system_parameters, only: parameters_t
  use lapwing_system_start, only: start_from
  use lapwing_system, only: system_t
  use test_systems, only: ball_t, forced_mass_t
  implicit none

  type(tally_t) :: tally

  call test_bouncing_ball()
  call test_no_restitution()
  call test_two_walls()
  call test_impact_orbit(separation_speed=1.0_wp, restitution=0.8_wp)
  call test_impact_orbit(separation_speed=0.5_wp, restitution=0.6_wp)
  call test_kink_in_flight()
  call test_knot_at_impact()
  call test_bounds()
  call tally%finish()

contains

  !> Advance until an event of a kind; the time since phase 0 of the first cycle. Counts impacts.
  subroutine next_event(system, numerics, state, work, kind, event, time, impacts)
    class(system_t), intent(in) :: system           !! what moves
    type(numerics_t), intent(in) :: numerics        !! tolerances
    type(hybrid_state_t), intent(inout) :: state    !! state
    type(work_t), intent(inout) :: work             !! counts
    integer, intent(in) :: kind                     !! kind waited for
    type(event_t), intent(out) :: event             !! the event
    real(wp), intent(out) :: time                   !! when
    integer, intent(inout) :: impacts               !! impacts seen
    type(segment_t) :: segment
    integer :: i, status, calls
    do calls = 1, 1000000
      call advance(system, rk4_flow_t(), numerics, state, segment, work, status)
      call tally%equal(status, status_ok, "advance: status")
      if (status /= status_ok) exit
      do i = 1, segment%n_events
        event = segment%events(i)
        time = event%cycle*system%period + event%t
        if (event%kind <= event_kind(event_impact, coast_flank)) impacts = impacts + 1
        if (event%kind == kind) return
      end do
    end do
    call tally%is_true(.false., "an event that never came")
  end subroutine next_event

  !> A ball dropped from height H comes to rest after sqrt(2H/a)(1 + eps)/(1 - eps). Of N bounces
  !> followed each adds a few units of the time in the cycle; nothing else is lost, because what is
  !> not followed is summed exactly here.
  subroutine test_bouncing_ball()
    real(wp), parameter :: restitution(4) = [0.3_wp, 0.5_wp, 0.8_wp, 0.95_wp]
    real(wp), parameter :: period(2) = [100.0_wp, 3.0_wp]
    type(ball_t) :: ball
    type(hybrid_state_t) :: state
    type(numerics_t) :: numerics
    type(work_t) :: work
    type(event_t) :: event
    real(wp) :: time, exact, worst
    integer :: i, k, impacts, followed
    worst = 0
    do i = 1, 4
      do k = 1, 2
        ball%law = rigid_t(restitution=restitution(i))
        ball%pull = 2
        ball%period = period(k)
        state = hybrid_state_t()
        state%instant%y(1) = -0.7_wp
        impacts = 0
        call next_event(ball, numerics, state, work, event_chatter_end, event, time, impacts)
        exact = sqrt(0.7_wp)*(1 + restitution(i))/(1 - restitution(i))
        worst = max(worst, abs(time - exact))
        ! The last one followed leaves less than 1e-7 periods: 2 sqrt(0.7) eps**n/(1 - eps).
        followed = ceiling(log(1.0e-7_wp*period(k)*(1 - restitution(i))/(2*sqrt(0.7_wp))) &
            /log(restitution(i)))
        call tally%equal(impacts, followed, "impacts followed")
        call tally%near(time, exact, 4*(followed + 2)*spacing(period(k)) &
            + 4*exact*epsilon(exact), "the ball comes to rest")
        call tally%equal(state%instant%motion_state, engagement, "the ball rests")
        call stays(ball, state)
      end do
    end do
    print "(a, es9.2)", "measured: accumulation time off by at most ", worst
  end subroutine test_bouncing_ball

  !> A pressed ball stays where it is for three cycles.
  subroutine stays(ball, state)
    type(ball_t), intent(in) :: ball                !! the ball
    type(hybrid_state_t), intent(inout) :: state    !! state
    type(numerics_t) :: numerics
    type(segment_t) :: segment
    type(work_t) :: work
    integer :: i, status
    do i = 1, 3
      call advance(ball, rk4_flow_t(), numerics, state, segment, work, status)
      call tally%equal(segment%n_events, 0, "a resting ball has no events")
      call tally%near(state%instant%y(1), 0.0_wp, 0.0_wp, "a resting ball stays")
      call tally%is_true(segment%cycle_completed, "a resting ball: a call per cycle")
    end do
  end subroutine stays

  !> eps = 0: the ball stays at the first impact.
  subroutine test_no_restitution()
    type(ball_t) :: ball
    type(hybrid_state_t) :: state
    type(numerics_t) :: numerics
    type(work_t) :: work
    type(event_t) :: event
    real(wp) :: time
    integer :: impacts
    ball%law = rigid_t(restitution=0.0_wp)
    ball%period = 7
    state%instant%y(1) = -0.5_wp
    impacts = 0
    call next_event(ball, numerics, state, work, event_engage, event, time, impacts)
    call tally%equal(impacts, 1, "eps = 0: one impact")
    call tally%near(time, 1.0_wp, 4*spacing(7.0_wp), "eps = 0: when")
  end subroutine test_no_restitution

  !> Elastic between two walls under a constant force: speeds 2 at the drive flank and sqrt(2) at
  !> the coast flank, 2 (2 - sqrt(2)) per round. Rounding of one flight in speed is some units; in
  !> 2e4 of them that adds up to at most 2e4*10 units. A round depends on the speed v by the factor
  !> 2 (1 - v/sqrt(v**2 - 2)) = -0.83, and its two times are rounded to a few units.
  subroutine test_two_walls()
    integer, parameter :: rounds = 10000
    real(wp), parameter :: drift = 2*rounds*10*epsilon(1.0_wp)
    type(ball_t) :: ball
    type(hybrid_state_t) :: state
    type(numerics_t) :: numerics
    type(work_t) :: work
    type(event_t) :: event
    real(wp) :: time, worst, exact
    integer :: i, impacts
    ball%law = relative_impact_t(restitution=1.0_wp)
    ball%wall = [0.0_wp, -1.0_wp]
    ball%period = 3
    state%instant%y(2) = -2
    impacts = 0
    worst = 0
    do i = 1, rounds
      call next_event(ball, numerics, state, work, event_impact, event, time, impacts)
      worst = max(worst, abs(event%before - 2))
    end do
    exact = rounds*2*(2 - sqrt(2.0_wp))
    print "(a, 2es9.2)", "measured: 1e4 elastic rounds, drift of speed and time ", worst, &
        abs(time - exact)
    call tally%equal(impacts, 2*rounds, "both walls are hit in every round")
    call tally%below(worst, drift, "elastic walls: drift of the speed")
    call tally%near(time, exact, rounds*(worst + 8*spacing(3.0_wp)), "elastic walls: time")
  end subroutine test_two_walls

  !> The impact oscillator x'' + x = A cos(w t), x <= 0, with its orbit of one impact per period.
  !>
  !> Between impacts x = a cos t + b sin t + G cos(w t + psi), G = A/(1 - w**2), t from the impact.
  !> x(0) = x(P) = 0 and x'(0) = -eps x'(P) give b = a tan(P/2), G cos psi = -a and
  !> G w sin psi = b (1 - eps)/(1 + eps); the impact speed is -2b/(1 + eps). At w = 2.2 both
  !> multipliers of the return map are a complex pair of modulus eps (its determinant is eps**2):
  !> the orbit attracts.
  subroutine test_impact_orbit(separation_speed, restitution)
    real(wp), intent(in) :: separation_speed   !! -b, rad per tau
    real(wp), intent(in) :: restitution        !! eps
    real(wp), parameter :: w = 2.2_wp
    type(forced_mass_t) :: mass
    type(hybrid_state_t) :: state
    real(wp) :: a, b, g, psi, at, speed
    mass%period = 8*atan(1.0_wp)/w
    mass%law = relative_impact_t(restitution=restitution)
    mass%wall = [0.0_wp, -100.0_wp]
    b = -separation_speed
    a = b/tan(mass%period/2)
    psi = atan2(b*(1 - restitution)/(1 + restitution)/w, -a)
    g = -a/cos(psi)
    ! The force is A cos(w t' + psi), t' from the impact: in cycle time the impact is at psi/w,
    ! where A = G (1 - w**2) < 0 stands for a shift of half a period.
    mass%amplitude = g*(1 - w**2)
    at = modulo(psi/w, mass%period)
    speed = -2*b/(1 + restitution)
    state%instant%t = at
    state%instant%y(1:2) = [0.0_wp, -restitution*speed]
    call follow_orbit(mass, state, at, speed, 1.0e-9_wp, 20, .true.)
    ! From elsewhere: 0.8**200 is nothing.
    state = hybrid_state_t()
    state%instant%t = at
    state%instant%y(1:2) = [0.0_wp, -1.05_wp*restitution*speed]
    call follow_orbit(mass, state, at, speed, 1.0e-9_wp, 200, .false.)
  end subroutine test_impact_orbit

  !> Impact times and speeds over some cycles. `exactly`: from the first one on, else at the end.
  !>
  !> Error: at most 1e-10/256 per step of size 1, some 200 steps per period, what an impact hands on
  !> shrinks by eps, so that at most 1/(1 - eps) = 5 periods' errors are seen: 4e-10.
  subroutine follow_orbit(mass, state, at, speed, tolerance, cycles, exactly)
    type(forced_mass_t), intent(in) :: mass         !! the oscillator
    type(hybrid_state_t), intent(inout) :: state    !! state
    real(wp), intent(in) :: at, speed               !! of the periodic impact
    real(wp), intent(in) :: tolerance               !! of both
    integer, intent(in) :: cycles                   !! periods
    logical, intent(in) :: exactly                  !! whether it begins on the orbit
    type(numerics_t) :: numerics
    type(work_t) :: work
    type(event_t) :: event
    real(wp) :: time, worst
    integer :: i, impacts
    impacts = 0
    worst = 0
    do i = 1, cycles
      call next_event(mass, numerics, state, work, event_impact, event, time, impacts)
      if (i < cycles .and. .not. exactly) cycle
      worst = max(worst, abs(event%before - speed), abs(time - (at + i*mass%period)))
    end do
    print "(a, es9.2, a, f7.1)", "measured: impact oscillator off by ", worst, &
        ", steps per period ", work%steps/cycles
    call tally%below(worst, tolerance, "impact oscillator: time and speed of the impact")
  end subroutine follow_orbit

  !> A flank that stands, kinks towards the tooth and away: F = 2, kink at 1 by -0.2 where phi = -1,
  !> phi' = 2.2 after it; then phi = -1 + 2.2 s + s**2 reaches 0 at s = sqrt(2.21) - 1.1.
  subroutine test_kink_in_flight()
    type(oscillator_t) :: gear
    type(hybrid_state_t) :: state
    type(numerics_t) :: numerics
    type(work_t) :: work
    type(event_t) :: event
    real(wp) :: c(0:5, 2), time
    integer :: impacts
    c = 0
    c(1, 1) = 0.2_wp
    c(0:1, 2) = [0.1_wp, -0.2_wp]
    gear = gear_with(c, [.false., .true.])
    state%instant = start_from(gear, 0.0_wp, separation, -2.0_wp, 0.0_wp)
    impacts = 0
    call next_event(gear, numerics, state, work, event_impact, event, time, impacts)
    call tally%near(time, sqrt(2.21_wp) - 0.1_wp, 10*epsilon(time), "impact after a kink in flight")
    call tally%near(event%before, 2*sqrt(2.21_wp), 20*epsilon(time), "speed after a kink in flight")
  end subroutine test_kink_in_flight

  !> A plane flank cut in two where the tooth arrives: nothing is lost at the knot.
  subroutine test_knot_at_impact()
    type(oscillator_t) :: gear
    type(hybrid_state_t) :: state
    type(numerics_t) :: numerics
    type(work_t) :: work
    type(event_t) :: event
    real(wp) :: c(0:5, 2), time
    integer :: impacts, i
    c = 0
    gear = gear_with(c, [.false., .false.])
    do i = -20, 20
      ! Arrives within 20 roundings of the knot at 1, on either side.
      state = hybrid_state_t()
      state%instant = start_from(gear, 0.0_wp, separation, -1 + i*epsilon(1.0_wp), 0.0_wp)
      impacts = 0
      call next_event(gear, numerics, state, work, event_impact, event, time, impacts)
      call tally%near(time, 1.0_wp, 50*epsilon(time), "impact at a knot")
    end do
  end subroutine test_knot_at_impact

  !> F = 2, mesh period 2, a knot in the middle, no restitution lost, a far coast flank.
  function gear_with(c, kinks) result(gear)
    real(wp), intent(in) :: c(0:5, 2)     !! table
    logical, intent(in) :: kinks(2)       !! kinks
    type(oscillator_t) :: gear
    type(parameters_t) :: p
    p%force = 2
    p%mesh_frequency_ratio = 4*atan(1.0_wp)
    p%restitution = 0.5_wp
    p%backlash = 100
    p%peak_to_peak = 1
    gear = oscillator(p, [0.0_wp, 0.5_wp, 1.0_wp], c, kinks)
  end function gear_with

  !> What could go on for ever ends with its name.
  subroutine test_bounds()
    use, intrinsic :: ieee_arithmetic, only: ieee_set_halting_mode, ieee_invalid, ieee_value, &
        ieee_quiet_nan, ieee_set_flag
    type(ball_t) :: ball
    integer :: status
    ball%law = relative_impact_t(restitution=1.0_wp)
    ball%period = 1.0e4_wp
    call status_of(ball, -1.0_wp, numerics_t(max_events_per_cycle=50), status)
    call tally%equal(status, status_too_many_events, "too many events")
    call status_of(ball, -1.0_wp, numerics_t(max_steps_per_cycle=50), status)
    call tally%equal(status, status_too_many_steps, "too many steps")
    call ieee_set_halting_mode(ieee_invalid, .false.)
    call status_of(ball, ieee_value(1.0_wp, ieee_quiet_nan), numerics_t(), status)
    call ieee_set_flag(ieee_invalid, .false.)
    call ieee_set_halting_mode(ieee_invalid, .true.)
    call tally%equal(status, status_not_finite, "not a number")
  end subroutine test_bounds

  subroutine status_of(ball, x, numerics, status)
    type(ball_t), intent(in) :: ball            !! what moves
    real(wp), intent(in) :: x                   !! where from
    type(numerics_t), intent(in) :: numerics    !! bounds
    integer, intent(out) :: status              !! how it ends
    type(hybrid_state_t) :: state
    type(segment_t) :: segment
    type(work_t) :: work
    integer :: i
    state%instant%y(1) = x
    do i = 1, 1000
      call advance(ball, rk4_flow_t(), numerics, state, segment, work, status)
      if (status /= status_ok) return
    end do
  end subroutine status_of
end program test_automaton
