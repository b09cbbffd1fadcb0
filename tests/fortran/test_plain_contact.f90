!> What is left out is left out without effect: what the automaton saves at the beginning of a step
!> changes no bit, and neither a bound on a contact nor skipping ahead in a flight hides a crossing
!> that a search of every piece finds.
program test_plain_contact
  use assertions, only: tally_t
  use exact_reference, only: seed, uniform, chance, pick, random_table
  use lapwing_hybrid_automaton, only: advance
  use lapwing_system_exclusion, only: no_sooner
  use lapwing_codes, only: drive_flank, separation, engagement, law_restitution, law_compliant, &
      gap_one_sided, gap_symmetric, gap_one_flank, status_ok
  use lapwing_flow, only: work_t
  use lapwing_flow_rk4_crossing, only: crossing_t, find_crossing
  use lapwing_flow_rk4_rk4_flow, only: rk4_flow_t
  use lapwing_system_frames, only: flank_in_frame, flank_over_step
  use lapwing_hybrid_state, only: hybrid_state_t, numerics_t, segment_t
  use lapwing_kinds, only: wp
  use lapwing_system_oscillator, only: oscillator_t
  use test_systems, only: oscillator
  use lapwing_system_parameters, only: parameters_t
  use lapwing_system_start, only: start_from
  use lapwing_system, only: instant_t, frame_t
  use test_systems, only: thorough_t, careful
  implicit none

  integer, parameter :: n_scenes = 150, n_steps = 300
  type(tally_t) :: tally
  integer :: plain, skips, crossings, ends
  real(wp) :: searches, all_searches

  call seed(20261122)
  plain = 0
  skips = 0
  crossings = 0
  ends = 0
  searches = 0
  all_searches = 0
  call test_no_sooner()
  call test_flank_over_step()
  call test_same_bits(law_compliant)
  call test_same_bits(law_restitution)
  print "(6(a, i0))", "measured: plain steps ", plain, ", flights ", skips, ", crossings ", &
      crossings, ", ends of contacts ", ends, ", pieces searched for a depth ", nint(searches), &
      " of ", nint(all_searches)
  call tally%below(10000.0_wp, real(plain, wp), "plain steps")
  call tally%below(1000.0_wp, real(crossings, wp), "crossings")
  call tally%below(100.0_wp, real(ends, wp), "crossings that end a contact")
  call tally%is_true(searches < all_searches, "pieces are spared a search for a depth")
  call tally%finish()

contains

  !> d - a s - pull s**2/2 is zero there, whatever the signs; or it never is.
  subroutine test_no_sooner()
    real(wp) :: distance, approach, pull, s
    integer :: i
    do i = 1, 1000
      distance = pick([0.0_wp, uniform(0.0_wp, 1.0_wp)])
      approach = uniform(-1.0_wp, 1.0_wp)
      pull = uniform(-1.0_wp, 1.0_wp)
      s = no_sooner(distance, approach, pull)
      if (s > 1.0e6_wp) then
        call tally%is_true(approach**2 + 2*pull*distance < 0 .or. (approach <= 0 .and. pull <= 0), &
            "never")
      else
        call tally%near(distance - approach*s - 0.5_wp*pull*s**2, 0.0_wp, &
            20*epsilon(s)*(1 + abs(approach)*s + abs(pull)*s**2), "no sooner")
      end if
    end do
    call tally%near(no_sooner(-1.0_wp, -1.0_wp, 1.0_wp), 0.0_wp, 0.0_wp, "beyond the flank")
    call tally%near(no_sooner(0.0_wp, 0.0_wp, 1.0_wp), 0.0_wp, 0.0_wp, "resting on the flank")
  end subroutine test_no_sooner

  !> On one piece or over several: what is found at one time, to the same bit at the end.
  subroutine test_flank_over_step()
    type(oscillator_t) :: system
    type(instant_t) :: instant
    type(frame_t) :: frame
    real(wp) :: h, position(4), slope(4), one_position, one_slope
    integer :: i, k
    do i = 1, 200
      system = random_oscillator(law_compliant)
      instant%motion_state = engagement
      instant%t = uniform(0.0_wp, 0.9_wp)*system%period
      call system%open_frame(instant, frame)
      h = uniform(0.0_wp, 1.0_wp)*frame%stop
      call flank_over_step(system%path, frame, h, position, slope)
      do k = 1, 4
        call flank_in_frame(system%path, frame, k*(0.25_wp*h), one_position, one_slope)
        call tally%near(position(k), one_position, 1.0e-14_wp, "position at a quarter")
        call tally%near(slope(k), one_slope, 1.0e-13_wp, "slope at a quarter")
      end do
      call tally%is_true(position(4) == one_position .and. slope(4) == one_slope, "at the end")
    end do
  end subroutine test_flank_over_step

  !> A random oscillator.
  function random_oscillator(contact_law) result(system)
    integer, intent(in) :: contact_law               !! law
    type(oscillator_t) :: system
    type(parameters_t) :: p
    real(wp), allocatable :: knots(:), coefficients(:, :)
    logical, allocatable :: kinks(:)
    p%contact_law = contact_law
    p%force = uniform(-0.3_wp, 1.5_wp)
    p%mesh_frequency_ratio = uniform(0.1_wp, 2.0_wp)
    p%peak_to_peak = 1
    p%damping_ratio = pick([0.0_wp, 0.05_wp, 0.3_wp, 1.2_wp])
    p%restitution = pick([0.0_wp, 0.3_wp, 0.9_wp, 1.0_wp])
    p%backlash = 10.0_wp**uniform(-0.5_wp, 1.0_wp)
    p%tolerance = 1.0e-5_wp
    p%gap = int(pick(real([gap_one_sided, gap_one_sided, gap_symmetric, gap_one_flank], wp)))
    p%back_flank_te = chance(0.8_wp)
    ! A standing coast flank must be out of the drive flank's reach.
    if (.not. p%back_flank_te) p%backlash = p%backlash + 4
    call random_table(1 + int(uniform(0.0_wp, 30.0_wp)), 0.1_wp, knots, coefficients, kinks)
    system = oscillator(p, knots, coefficients, kinks)
  end function random_oscillator

  !> Two ways from every state of a motion, and two searches of every step.
  subroutine test_same_bits(contact_law)
    integer, intent(in) :: contact_law               !! law
    type(oscillator_t) :: system
    type(rk4_flow_t) :: flow
    type(hybrid_state_t) :: state, other
    type(instant_t) :: begin
    type(segment_t) :: segment, other_segment
    type(numerics_t) :: numerics
    type(work_t) :: work, other_work
    integer :: i, k, status, other_status
    numerics%tolerance = 1.0e-5_wp
    do i = 1, n_scenes
      system = random_oscillator(contact_law)
      state = hybrid_state_t()
      state%instant = start_from(system, uniform(0.0_wp, 0.9_wp), engagement, &
          uniform(0.01_wp, 1.0_wp), uniform(-1.0_wp, 1.0_wp))
      do k = 1, n_steps
        other = state
        begin = state%instant
        work = work_t()
        other_work = work_t()
        if (system%begins_clear(begin, 0.0_wp)) plain = plain + 1
        call advance(system, flow, numerics, state, segment, work, status)
        call advance(careful(system), flow, numerics, other, other_segment, other_work, &
            other_status)
        call tally%equal(status, other_status, "status")
        call tally%is_true(same_state(state, other), "state, bit for bit")
        call tally%is_true(same_motion(segment, other_segment), "what happened, bit for bit")
        call tally%is_true(work%steps == other_work%steps, "count of steps")
        if (status /= status_ok) exit
        if (segment%moves) call search_both_ways(system, segment)
      end do
    end do
  end subroutine test_same_bits

  !> Every piece of a step, and those that are looked at: the same crossing to rounding.
  subroutine search_both_ways(system, segment)
    type(oscillator_t), intent(in) :: system         !! what moves
    type(segment_t), intent(in) :: segment           !! a step it took
    type(thorough_t) :: thorough
    type(crossing_t) :: found, searched
    type(work_t) :: work
    thorough%oscillator_t = system
    associate (begin => segment%begin)
      call find_crossing(thorough, segment%frame, begin%motion_state, begin%touching, &
          segment%motion, work, searched)
      if (begin%motion_state /= separation) then
        if (segment%n_events == 0 .and. segment%length == segment%motion%h .and. &
            .not. segment%cycle_completed) then
          call tally%is_true(.not. searched%found, "a step without an event crosses nothing")
        end if
      end if
      call find_crossing(system, segment%frame, begin%motion_state, begin%touching, &
          segment%motion, work, found)
    end associate
    if (segment%begin%motion_state == separation) then
      skips = skips + 1
      call measure_both_ways(system, thorough, segment)
    end if
    call tally%is_true(found%found .eqv. searched%found, "found or not")
    call tally%equal(found%frame%piece, searched%frame%piece, "piece")
    if (.not. (found%found .and. searched%found)) return
    crossings = crossings + 1
    if (segment%begin%motion_state /= separation) ends = ends + 1
    call tally%equal(found%flank, searched%flank, "flank")
    ! Flank and path below 10, rounded on the way over some pieces; slopes above 1e-4 by far most.
    call tally%near(found%s, searched%s, 1.0e-10_wp, "time")
  end subroutine search_both_ways

  !> The depth of a flight, every piece looked at or not, and from any depth known before.
  subroutine measure_both_ways(system, thorough, segment)
    type(oscillator_t), intent(in) :: system         !! what moves
    type(thorough_t), intent(in) :: thorough         !! the same
    type(segment_t), intent(in) :: segment           !! a step it took
    type(rk4_flow_t) :: flow
    type(work_t) :: work, other_work
    real(wp) :: depth, other, least
    integer :: k
    least = 0
    do k = 1, 3
      call flow%farthest(system, segment%arc_t, drive_flank, least, depth, work)
      call flow%farthest(thorough, segment%arc_t, drive_flank, least, other, other_work)
      call tally%is_true(depth == other, "depth, bit for bit")
      least = pick([uniform(0.0_wp, 1.0_wp)*other, other])
    end do
    searches = searches + work%depth_searches
    all_searches = all_searches + other_work%depth_searches
  end subroutine measure_both_ways

  pure logical function same_state(one, other)
    type(hybrid_state_t), intent(in) :: one, other   !! states
    associate (a => one%instant, b => other%instant)
      same_state = a%motion_state == b%motion_state .and. a%chart == b%chart &
          .and. a%touching == b%touching .and. a%cycle == b%cycle .and. a%piece == b%piece &
          .and. a%t == b%t .and. all(a%y == b%y) .and. all(one%memory%step == other%memory%step) &
          .and. all(one%memory%ratio == other%memory%ratio) &
          .and. one%steps_in_cycle == other%steps_in_cycle
    end associate
  end function same_state

  pure logical function same_motion(one, other) result(same)
    type(segment_t), intent(in) :: one, other        !! segments
    same = one%begin%motion_state == other%begin%motion_state &
        .and. one%begin%cycle == other%begin%cycle &
        .and. one%begin%t == other%begin%t .and. one%length == other%length &
        .and. (one%moves .eqv. other%moves) .and. one%n_events == other%n_events &
        .and. (one%cycle_completed .eqv. other%cycle_completed)
    if (.not. (same .and. one%moves)) return
    same = one%motion%h == other%motion%h .and. one%frame%piece == other%frame%piece &
        .and. all(one%motion%dense(:, 1:2) == other%motion%dense(:, 1:2)) &
        .and. one%frame%stop == other%frame%stop .and. one%frame%origin == other%frame%origin &
        .and. one%frame%origin_rate == other%frame%origin_rate
  end function same_motion
end program test_plain_contact
