!> What the automaton saves at the beginning of an arc in closed form changes no bit; and no kink,
!> cycle or flank is lost on the way.
program test_exact_automaton
  use assertions, only: tally_t
  use exact_reference, only: seed, uniform, chance, pick, random_table, random_series
  use lapwing_hybrid_automaton, only: advance
  use lapwing_codes, only: separation, engagement, law_restitution, law_compliant, law_rigid, &
      law_relative, law_absolute, gap_one_sided, gap_symmetric, gap_one_flank, method_exact, &
      event_kink, status_ok
  use lapwing_flow, only: work_t
  use lapwing_flow_exact_exact_flow, only: exact_flow_t, make_exact_flow
  use lapwing_hybrid_state, only: hybrid_state_t, numerics_t, segment_t
  use lapwing_kinds, only: wp
  use lapwing_system_oscillator, only: oscillator_t
  use test_systems, only: oscillator
  use lapwing_system_parameters, only: parameters_t
  use lapwing_polynomial_evaluation, only: max_degree
  use lapwing_system, only: frame_t
  use lapwing_system_start, only: start_at_rest, start_from
  use test_systems, only: careful
  implicit none

  type(tally_t) :: tally
  !> What a frame that was not opened still holds: the plain path opens none.
  real(wp), parameter :: unopened = -77.0_wp
  integer, parameter :: n_scenes = 240, n_stretches = 200
  integer :: plain, special, seen(16)

  call seed(20261127)
  plain = 0
  special = 0
  seen = 0
  call test_same_bits(law_restitution, law_relative)
  call test_same_bits(law_restitution, law_absolute)
  call test_same_bits(law_compliant, law_relative)
  call test_same_bits(law_rigid, law_relative)
  call test_meeting_at_the_stop()
  print "(a, i0, a, i0)", "measured: plain arcs ", plain, ", others ", special
  call tally%below(100000.0_wp, real(plain, wp), "plain arcs")
  call tally%is_true(all(seen(1:9) > 20), "every kind of event at either flank")
  call tally%finish()

contains

  !> A random oscillator with a closed form.
  function random_oscillator(number, contact_law, impact_law) result(system)
    integer, intent(in) :: number                    !! decides what it is
    integer, intent(in) :: contact_law, impact_law   !! laws
    type(oscillator_t) :: system
    type(parameters_t) :: p
    real(wp), allocatable :: knots(:), coefficients(:, :), series(:, :)
    logical, allocatable :: kinks(:)
    p%contact_law = contact_law
    p%impact_law = impact_law
    p%force = uniform(-0.3_wp, 1.5_wp)
    p%mesh_frequency_ratio = 1/(real(int(uniform(0.0_wp, 5.0_wp)), wp) + uniform(0.3_wp, 0.7_wp))
    p%flank_scale = merge(1.0_wp, -1.0_wp, chance(0.5_wp))
    p%peak_to_peak = 1
    p%damping_ratio = pick([0.0_wp, 0.05_wp, 0.3_wp, 1.0_wp, 1.2_wp])
    p%restitution = pick([0.0_wp, 0.3_wp, 0.7_wp, 0.9_wp, 1.0_wp])
    p%backlash = 10.0_wp**uniform(-1.5_wp, 1.5_wp)
    p%gap = int(pick(real([gap_one_sided, gap_one_sided, gap_symmetric, gap_one_flank], wp)))
    p%back_flank_te = chance(0.8_wp)
    ! A standing coast flank must be out of the drive flank's reach.
    if (.not. p%back_flank_te) p%backlash = p%backlash + 4
    if (mod(number, 2) == 0) then
      series = random_series(1 + int(uniform(0.0_wp, 3.0_wp)))
      system = oscillator(p, [0.0_wp, 1.0_wp], zeros(), [.false.], series)
    else
      call random_table(1 + int(uniform(0.0_wp, 9.0_wp)), 0.3_wp, knots, coefficients, kinks)
      if (size(kinks) == 1) kinks = .true.
      system = oscillator(p, knots, coefficients, kinks, reshape([-1.0_wp, 0.0_wp, 0.0_wp], &
          [3, 1]))
    end if
  end function random_oscillator

  pure function zeros() result(c)
    real(wp) :: c(0:max_degree, 1)
    c = 0
  end function zeros

  !> Two ways from every state of a motion: the same state, events and counts, bit for bit.
  subroutine test_same_bits(contact_law, impact_law)
    integer, intent(in) :: contact_law, impact_law   !! laws
    type(oscillator_t) :: system
    type(exact_flow_t) :: flow
    type(hybrid_state_t) :: state, other
    type(segment_t) :: segment, other_segment
    type(numerics_t) :: numerics
    type(work_t) :: work, other_work
    integer :: i, k, status, other_status
    integer :: error
    numerics%method = method_exact
    numerics%chatter_tolerance = 1.0e-13_wp
    do i = 1, n_scenes
      system = random_oscillator(i, contact_law, impact_law)
      call make_exact_flow(system, flow, error)
      call random_start(system, state)
      do k = 1, n_stretches
        other = state
        work = work_t()
        other_work = work_t()
        segment%frame%origin = unopened
        call advance(system, flow, numerics, state, segment, work, status)
        if (segment%frame%origin == unopened) then
          plain = plain + 1
        else
          special = special + 1
        end if
        call advance(careful(system), flow, numerics, other, other_segment, other_work, &
            other_status)
        call tally%equal(status, other_status, "status")
        call tally%is_true(same_state(state, other), "state, bit for bit")
        call tally%is_true(same_segment(segment, other_segment), "what happened, bit for bit")
        call tally%is_true(work%arcs == other_work%arcs, "count of arcs")
        if (segment%moves) call tally%is_true(same_motion(system, flow, segment, other_segment), &
            "motion on the way, bit for bit")
        if (status /= status_ok) exit
        call check_order(system, segment, state)
        call count_events(segment)
      end do
    end do
  end subroutine test_same_bits

  !> A flight that arrives within some units in the last place of a cycle's end, or of a kink: which
  !> of the two comes first is decided in the same way.
  subroutine test_meeting_at_the_stop()
    type(oscillator_t) :: system
    type(exact_flow_t) :: flow
    type(hybrid_state_t) :: state, other
    type(segment_t) :: segment, other_segment
    type(numerics_t) :: numerics
    type(work_t) :: work
    type(parameters_t) :: p
    integer :: i, law, status, stops, crossings
    integer :: error
    stops = 0
    crossings = 0
    p%force = 0
    p%backlash = 100
    p%mesh_frequency_ratio = 8*atan(1.0_wp)/8
    p%damping_ratio = 0.1_wp
    do law = law_restitution, law_compliant
      p%contact_law = law
      system = oscillator(p, [0.0_wp, 0.5_wp, 1.0_wp], reshape([0.0_wp, 0.0_wp, 0.0_wp, &
          0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 1.0_wp, -2.0_wp, 0.0_wp, 0.0_wp, 0.0_wp], [6, 2]), &
          [.true., .true.], reshape([-1.0_wp, 0.0_wp, 0.0_wp], [3, 1]))
      call make_exact_flow(system, flow, error)
      do i = -12, 12
        state%instant = start_from(system, 0.25_wp, separation, -3.0_wp, 1.5_wp*(1 + i &
            *epsilon(1.0_wp)))
        other = state
        call advance(system, flow, numerics, state, segment, work, status)
        call advance(careful(system), flow, numerics, other, other_segment, work, status)
        call tally%is_true(same_state(state, other), "state at a stop, bit for bit")
        call tally%is_true(same_segment(segment, other_segment), "what happened at a stop")
        stops = stops + merge(1, 0, segment%events(1)%kind == event_kink)
        crossings = crossings + merge(0, 1, segment%events(1)%kind == event_kink)
      end do
    end do
    call tally%below(9.0_wp, real(min(stops, crossings), wp), "both orders seen")
  end subroutine test_meeting_at_the_stop

  !> Rest, or a flight, or a contact.
  subroutine random_start(system, state)
    type(oscillator_t), intent(in) :: system         !! oscillator
    type(hybrid_state_t), intent(out) :: state       !! start
    real(wp) :: phase
    phase = uniform(0.0_wp, 1.0_wp)
    if (system%law%is_rigid() .or. chance(0.2_wp)) then
      if (system%force > 0) then
        state%instant = start_at_rest(system, phase)
        return
      end if
    end if
    if (chance(0.6_wp) .or. system%law%is_rigid()) then
      ! A standing coast flank may be nearer by the largest g; stay clear of it.
      state%instant = start_from(system, phase, separation, -0.01_wp*system%width, &
          uniform(-1.0_wp, 1.0_wp))
    else
      state%instant = start_from(system, phase, engagement, uniform(0.01_wp, 1.0_wp), &
          uniform(-1.0_wp, 1.0_wp))
    end if
  end subroutine random_start

  pure logical function same_state(one, other)
    type(hybrid_state_t), intent(in) :: one, other   !! states
    associate (a => one%instant, b => other%instant)
      same_state = a%motion_state == b%motion_state .and. a%chart == b%chart &
          .and. a%touching == b%touching .and. a%cycle == b%cycle .and. a%t == b%t &
          .and. all(a%y == b%y) .and. one%events_in_cycle == other%events_in_cycle &
          .and. one%steps_in_cycle == other%steps_in_cycle
    end associate
  end function same_state

  pure logical function same_segment(one, other) result(same)
    type(segment_t), intent(in) :: one, other        !! segments
    integer :: i
    same = one%begin%motion_state == other%begin%motion_state &
        .and. one%begin%cycle == other%begin%cycle &
        .and. one%begin%t == other%begin%t .and. one%length == other%length &
        .and. (one%moves .eqv. other%moves) &
        .and. one%n_events == other%n_events &
        .and. (one%cycle_completed .eqv. other%cycle_completed)
    if (.not. same) return
    do i = 1, one%n_events
      associate (a => one%events(i), b => other%events(i))
        same = same .and. a%kind == b%kind .and. a%cycle == b%cycle .and. a%t == b%t &
            .and. a%phi == b%phi .and. a%before == b%before .and. a%after == b%after
      end associate
    end do
  end function same_segment

  !> What observers will learn of the arc.
  logical function same_motion(system, flow, one, other) result(same)
    type(oscillator_t), intent(in) :: system         !! oscillator
    type(exact_flow_t), intent(in) :: flow           !! how it moves
    type(segment_t), intent(in) :: one, other        !! segments
    type(frame_t) :: frame
    real(wp) :: y(8), z(8)
    frame = one%frame
    call flow%state_at(system, one%arc_t, 0.4_wp*one%length, frame, y)
    call flow%state_at(system, other%arc_t, 0.4_wp*other%length, frame, z)
    same = all(y == z) .and. one%frame%stop == other%frame%stop &
        .and. one%frame%stop_knot == other%frame%stop_knot .and. one%frame%t == other%frame%t &
        .and. one%frame%chart == other%frame%chart .and. one%frame%piece == other%frame%piece
  end function same_motion

  !> Time goes on, no kink is passed unseen, and the tooth is where its motion state says.
  subroutine check_order(system, segment, state)
    type(oscillator_t), intent(in) :: system         !! oscillator
    type(segment_t), intent(in) :: segment           !! what happened
    type(hybrid_state_t), intent(in) :: state        !! state after it
    real(wp) :: ends, phi, phi_dot
    integer :: i
    call tally%is_true(segment%length >= 0, "time goes on")
    ends = segment%begin%t + segment%length
    do i = 1, system%path%n + 1
      if (.not. system%path%kink(i) .or. system%path%knot(i) <= segment%begin%t) cycle
      call tally%below(ends, system%path%knot(i) + 2*spacing(system%period), "kink passed over")
    end do
    call tally%below(ends, system%period + 2*spacing(system%period), "cycle passed over")
    call system%observe(state%instant, phi, phi_dot)
    if (state%instant%motion_state == engagement) then
      call tally%below(-phi, 1.0e-12_wp*(1 + abs(phi_dot)), "in engagement, but outside")
    else if (state%instant%motion_state == separation) then
      call tally%below(phi, 1.0e-12_wp*(1 + abs(phi_dot)), "in separation, but in the drive flank")
    end if
  end subroutine check_order

  subroutine count_events(segment)
    type(segment_t), intent(in) :: segment           !! what happened
    integer :: i
    do i = 1, segment%n_events
      associate (kind => segment%events(i)%kind)
        seen(kind) = seen(kind) + 1
      end associate
    end do
  end subroutine count_events
end program test_exact_automaton
