!> The tangent map against finite differences of the automaton, one saltation matrix at a time.
program test_tangent_map
  use assertions, only: tally_t
  use lapwing_codes, only: separation, engagement, back_engagement, law_compliant, law_rigid, &
      law_relative, law_absolute, status_ok
  use lapwing_flow, only: work_t
  use lapwing_hybrid_state, only: hybrid_state_t, numerics_t
  use lapwing_flow_rk4_rk4_flow, only: rk4_flow_t
  use lapwing_kinds, only: wp
  use lapwing_system_oscillator, only: oscillator_t
  use test_systems, only: oscillator
  use lapwing_system_parameters, only: parameters_t
  use lapwing_observers_deviations, only: deviations_of
  use lapwing_observers_records, only: recorder_t, cycle_columns
  use lapwing_run, only: run_to, deadline_in
  use lapwing_system_start, only: start_from
  use lapwing_observers_tangent, only: tangent_columns, impact_matrix
  implicit none

  real(wp), parameter :: period = 4
  !> Central differences of a map of curvature up to some 1e2, whose events are found to some
  !> 1e-13: with a difference of 1e-6 both errors are below some 1e-7 of the largest element,
  !> beside elements of a/v up to 10.
  real(wp), parameter :: difference = 1.0e-6_wp, allowed = 1.0e-6_wp
  type(tally_t) :: tally
  type(parameters_t) :: base

  base%force = 1
  base%mesh_frequency_ratio = 8*atan(1.0_wp)/period
  base%damping_ratio = 0.15_wp
  base%restitution = 0.6_wp
  base%backlash = 3
  base%peak_to_peak = 0.2_wp
  base%tolerance = 1.0e-13_wp
  call test_drive_flank()
  call test_coast_flank()
  call test_absolute()
  call test_compliant()
  call test_no_restitution()
  call test_chatter()
  call test_rigid()
  call test_graze_is_told()
  call test_scaling()
  call tally%finish()

contains

  !> g over two pieces: curvature and its rate jump in the middle, the slope at phase 0.
  function gear(p) result(system)
    type(parameters_t), intent(in) :: p     !! parameters
    type(oscillator_t) :: system
    real(wp) :: c(0:5, 2)
    c(:, 1) = [0.02_wp, 0.1_wp, 0.3_wp, -0.4_wp, 0.2_wp, 0.1_wp]
    c(:, 2) = 0
    c(0:1, 2) = [sum(c(:, 1)*0.5_wp**[0, 1, 2, 3, 4, 5]), &
        sum([1, 2, 3, 4, 5]*c(1:, 1)*0.5_wp**[0, 1, 2, 3, 4])]
    c(2:3, 2) = [-0.5_wp, 0.3_wp]
    system = oscillator(p, [0.0_wp, 0.5_wp, 1.0_wp], c, [.true., .false.])
  end function gear

  !> Run one cycle from phase 0; the state at its end and its line of the tangent map.
  subroutine one_cycle(system, motion_state, y, state, row, cycle)
    type(oscillator_t), intent(in) :: system              !! oscillator
    integer, intent(in) :: motion_state                   !! motion state at the start
    real(wp), intent(in) :: y(2)                          !! phi and phi' there
    type(hybrid_state_t), intent(out) :: state            !! state at the end
    real(wp), intent(out) :: row(tangent_columns)         !! line of the tangent map
    real(wp), intent(out) :: cycle(cycle_columns)         !! line of the cycle
    type(recorder_t) :: recorder
    type(work_t) :: work
    real(wp), target :: cycles(cycle_columns, 1), rows(tangent_columns, 1)
    integer :: status
    recorder%want_cycles = .true.
    recorder%want_tangent = .true.
    recorder%deviations = deviations_of(system)
    recorder%cycles => cycles
    recorder%tangent => rows
    state%instant = start_from(system, 0.0_wp, motion_state, y(1), y(2))
    call run_to(system, rk4_flow_t(), numerics_t(tolerance=1.0e-13_wp, &
        chatter_tolerance=1.0e-13_wp), 1, 0.0_wp, deadline_in(60.0_wp), state, recorder, work, &
        status)
    call tally%equal(status, status_ok, "run: status")
    row = rows(:, 1)
    cycle = cycles(:, 1)
  end subroutine one_cycle

  !> Compare matrix and differences; `expected` are impacts, back impacts, releases, back releases,
  !> engages, back engages, chatter ends, back chatter ends (a negative one: any number).
  subroutine compare(p, motion_state, y, expected, what)
    type(parameters_t), intent(in) :: p            !! parameters
    integer, intent(in) :: motion_state            !! motion state at the start
    real(wp), intent(in) :: y(2)                   !! phi and phi' there
    integer, intent(in) :: expected(8)             !! events of the cycle
    character(*), intent(in) :: what               !! in words
    type(oscillator_t) :: system
    type(hybrid_state_t) :: state
    real(wp) :: row(tangent_columns), cycle(cycle_columns), found(2, 2), m(2, 2), z(2), det
    real(wp) :: phi(2, -1:1), unused(tangent_columns)
    integer :: i, k, counts(8)
    system = gear(p)
    call one_cycle(system, motion_state, y, state, row, cycle)
    counts = nint(cycle([5, 6, 9, 10, 11, 12, 13, 14]))
    do i = 1, 8
      if (expected(i) >= 0) call tally%equal(counts(i), expected(i), what//": events")
    end do
    m = transpose(reshape(row(1:4), [2, 2]))*2.0_wp**nint(row(5))
    do k = 1, 2
      do i = -1, 1, 2
        z = y
        z(k) = z(k) + i*difference
        call one_cycle(system, motion_state, z, state, unused, cycle)
        call tally%is_true(all(nint(cycle([9, 10, 11, 12, 13, 14])) == counts(3:)), &
            what//": same events beside it")
        call system%observe(state%instant, phi(1, i), phi(2, i))
      end do
      found(:, k) = (phi(:, 1) - phi(:, -1))/(2*difference)
    end do
    do i = 1, 2
      do k = 1, 2
        call tally%near(m(i, k), found(i, k), allowed*max(1.0_wp, maxval(abs(found))), what)
      end do
    end do
    if (nint(row(8)) < 2) then
      call tally%is_true(row(6) < -huge(row), what//": no determinant")
      return
    end if
    det = row(7)*exp(row(6))
    call tally%near(m(1, 1)*m(2, 2) - m(1, 2)*m(2, 1), det, 1.0e-13_wp*maxval(abs(m))**2, &
        what//": determinant")
    call tally%near(row(6), row(11)*log(p%restitution) + row(12) &
        - 2*p%damping_ratio*sum(row(9:10)), 1.0e-13_wp*max(1.0_wp, abs(row(6))), what//": ln|det|")
  end subroutine compare

  subroutine test_drive_flank()
    type(parameters_t) :: p
    call compare(base, separation, [-2.0_wp, 0.1_wp], [1, 0, 0, 0, 0, 0, 0, 0], &
        "relative, drive flank")
    call compare(base, separation, [-0.3_wp, 0.6_wp], [-1, 0, 0, 0, 0, 0, 1, 0], &
        "relative, drive flank, to the end of its chatter")
    p = base
    p%force = 0.6_wp
    call compare(p, engagement, [0.4_wp, -0.9_wp], [2, 0, 1, 0, 0, 0, 0, 0], &
        "relative, release")
  end subroutine test_drive_flank

  subroutine test_coast_flank()
    type(parameters_t) :: p
    p = base
    p%force = -1
    p%backlash = 0.5_wp
    call compare(p, separation, [-0.2_wp, -0.1_wp], [0, -1, 0, 0, 0, 0, 0, 1], &
        "relative, coast flank")
    p%impact_law = law_absolute
    call compare(p, separation, [-0.2_wp, -0.1_wp], [0, 4, 0, 0, 0, 1, 0, 0], &
        "absolute, coast flank")
    p%back_flank_te = .false.
    call compare(p, separation, [-0.2_wp, -0.1_wp], [0, -1, 0, 0, 0, 0, 0, 1], &
        "absolute, standing coast flank")
    p%impact_law = law_relative
    call compare(p, back_engagement, [-0.9_wp, 2.0_wp], [1, 3, 0, 1, 0, 0, 0, 0], &
        "relative, begun on the standing coast flank")
    p = base
    p%force = 0.05_wp
    p%backlash = 0.2_wp
    call compare(p, separation, [-0.1_wp, -0.7_wp], [2, 2, 0, 0, 0, 0, 0, 0], &
        "relative, both flanks")
  end subroutine test_coast_flank

  subroutine test_absolute()
    type(parameters_t) :: p
    p = base
    p%impact_law = law_absolute
    call compare(p, separation, [-0.3_wp, 0.1_wp], [8, 0, 0, 0, 1, 0, 0, 0], &
        "absolute, drive flank")
    call compare(p, separation, [-0.05_wp, 0.02_wp], [13, 0, 0, 0, 1, 0, 0, 0], &
        "absolute, shallow")
    call compare(p, separation, [-2.0_wp, 0.1_wp], [1, 0, 0, 0, 0, 0, 0, 0], &
        "absolute, deep")
    p%force = 0.8_wp
    call compare(p, engagement, [0.1_wp, -0.6_wp], [7, 0, 1, 0, 1, 0, 0, 0], &
        "absolute, release, impact, engage")
  end subroutine test_absolute

  subroutine test_compliant()
    type(parameters_t) :: p
    p = base
    p%contact_law = law_compliant
    call compare(p, separation, [-0.3_wp, 0.1_wp], [0, 0, 0, 0, 1, 0, 0, 0], "compliant")
    p%damping_ratio = 1.7_wp
    call compare(p, separation, [-0.3_wp, 0.1_wp], [0, 0, 0, 0, 1, 0, 0, 0], "overdamped")
    p%damping_ratio = 0.05_wp
    p%force = 0.05_wp
    p%backlash = 0.2_wp
    call compare(p, separation, [-0.1_wp, -1.0_wp], [0, 0, 0, 1, 1, 1, 0, 0], &
        "compliant, both flanks")
  end subroutine test_compliant

  !> With eps = 0 and the relative law a pressed tooth engages at once.
  subroutine test_no_restitution()
    type(parameters_t) :: p
    p = base
    p%restitution = 0
    call compare(p, separation, [-0.3_wp, 0.1_wp], [1, 0, 0, 0, 1, 0, 0, 0], "eps = 0")
  end subroutine test_no_restitution

  !> Chatter that ends, the flank's acceleration changing all the while.
  subroutine test_chatter()
    type(parameters_t) :: p
    p = base
    p%restitution = 0.4_wp
    call compare(p, separation, [-0.05_wp, 0.1_wp], [-1, 0, 0, 0, 0, 0, 1, 0], "chatter")
    p%force = -1.5_wp
    p%backlash = 0.5_wp
    call compare(p, separation, [-0.45_wp, -0.1_wp], [0, -1, 0, 0, 0, 0, 0, 1], &
        "chatter, coast flank")
    p%back_flank_te = .false.
    call compare(p, separation, [-0.45_wp, -0.1_wp], [0, -1, 0, 0, 0, 0, 0, 1], &
        "chatter, standing coast flank")
  end subroutine test_chatter

  !> Bounces as with restitution; a tooth that has come to rest has forgotten everything.
  subroutine test_rigid()
    type(parameters_t) :: p
    p = base
    p%contact_law = law_rigid
    call compare(p, separation, [-2.0_wp, 0.1_wp], [1, 0, 0, 0, 0, 0, 0, 0], "rigid, bouncing")
    p%restitution = 0.4_wp
    call compare(p, separation, [-0.05_wp, 0.1_wp], [-1, 0, 0, 0, 0, 0, 1, 0], "rigid, at rest")
  end subroutine test_rigid

  !> An impact on a flank that draws away: v**2/(2|a|) is how far the tooth would have gone on.
  subroutine test_graze_is_told()
    type(parameters_t) :: p
    type(oscillator_t) :: system
    type(hybrid_state_t) :: state
    real(wp) :: row(tangent_columns), cycle(cycle_columns)
    p = base
    p%force = -1
    system = gear(p)
    call one_cycle(system, separation, [-0.02_wp, 0.205_wp], state, row, cycle)
    call tally%is_true(row(13) > 0 .and. row(13) < 0.02_wp, "a graze at the drive flank")
    call one_cycle(gear(base), separation, [-0.3_wp, 0.1_wp], state, row, cycle)
    call tally%is_true(row(13) > 1.0e300_wp, "no graze")
  end subroutine test_graze_is_told

  !> A map far from one is scaled by a power of two, which changes no digit.
  subroutine test_scaling()
    type(parameters_t) :: p
    type(oscillator_t) :: system
    type(hybrid_state_t) :: state
    real(wp) :: row(tangent_columns), cycle(cycle_columns), s(2, 2)
    p = base
    p%mesh_frequency_ratio = p%mesh_frequency_ratio/2000
    p%damping_ratio = 0.6_wp
    p%force = 100
    p%backlash = 1.0e3_wp
    p%tolerance = 1.0e-6_wp
    system = gear(p)
    call one_cycle(system, engagement, [100.0_wp, 0.0_wp], state, row, cycle)
    call tally%near(row(6), -2*0.6_wp*2000*period, 1.0e-8_wp, "ln|det| of a long contact")
    call tally%is_true(maxval(abs(row(1:4))) > 2.0_wp**(-300), "no underflow")
    call tally%below(abs(log(maxval(abs(row(1:4)))) + row(5)*log(2.0_wp) + 0.6_wp*2000*period), &
        2.0_wp, "its size")
    s = impact_matrix(2.0_wp, -1.0_wp, 0.5_wp, 3.0_wp)
    call tally%near(s(2, 1), 2.25_wp, epsilon(s), "impact: a/v")
  end subroutine test_scaling
end program test_tangent_map
