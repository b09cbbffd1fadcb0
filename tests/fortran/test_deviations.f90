!> Small deviations of any number of states: the exponential against closed forms, and the tangent
!> map of systems with four states against finite differences of the automaton.
program test_deviations
  use assertions, only: tally_t
  use lapwing_codes, only: separation, engagement, law_absolute, law_relative, law_compliant, &
      status_ok
  use lapwing_system_oscillation, only: damped, free_matrix
  use lapwing_contact_compliant, only: compliant_t
  use lapwing_contact_impact, only: relative_impact_t
  use lapwing_flank_fixed, only: fixed_flank_t
  use lapwing_flow, only: work_t
  use lapwing_flow_rk4_rk4_flow, only: rk4_flow_t
  use lapwing_hybrid_state, only: hybrid_state_t, numerics_t
  use lapwing_kinds, only: wp
  use lapwing_observers_deviations, only: deviations_t, deviations_of, move_deviations, exponential
  use lapwing_observers_records, only: recorder_t, cycle_columns
  use lapwing_run, only: run_to, deadline_in
  use lapwing_system_oscillator, only: oscillator_t
  use lapwing_system_parameters, only: parameters_t
  use lapwing_system_torsional_chain, only: torsional_chain_t, make_torsional_chain
  use lapwing_system, only: system_t, max_states
  use test_systems, only: two_masses_t, forced_mass_t
  implicit none

  integer, parameter :: columns = 4**2 + 9
  real(wp), parameter :: knots(2) = [0.0_wp, 1.0_wp]
  type(tally_t) :: tally

  call test_exponential()
  call test_jacobian()
  call test_oscillator()
  call test_two_masses()
  call test_chain()
  call tally%finish()

contains

  !> Rotation, decay, uniform motion; and e**(A s) e**(A t) = e**(A (s + t)). Squaring k times may
  !> lose 2**k digits' last units.
  subroutine test_exponential()
    real(wp) :: a(2, 2), s, e(3, 3), b(3, 3)
    integer :: i
    a = reshape([0.0_wp, -1.0_wp, 1.0_wp, 0.0_wp], [2, 2])
    do i = 1, 8
      s = 0.01_wp*3.0_wp**i
      call close_to(exponential(a, s), reshape([cos(s), -sin(s), sin(s), cos(s)], [2, 2]), &
          8*(1 + s)*epsilon(s), "rotation")
      call close_to(exponential(reshape([-0.3_wp], [1, 1]), s), &
          reshape([exp(-0.3_wp*s)], [1, 1]), 8*(1 + s)*epsilon(s), "decay")
    end do
    a = reshape([0.0_wp, 0.0_wp, 1.0_wp, 0.0_wp], [2, 2])
    call close_to(exponential(a, 1.0e8_wp), reshape([1.0_wp, 0.0_wp, 1.0e8_wp, 1.0_wp], [2, 2]), &
        0.0_wp, "uniform motion, exactly")
    b = reshape([0.1_wp, -0.4_wp, 0.7_wp, 0.2_wp, -1.1_wp, 0.5_wp, -0.9_wp, 0.3_wp, 0.6_wp], [3, 3])
    e = matmul(exponential(b, 0.7_wp), exponential(b, 1.6_wp))
    call close_to(exponential(b, 2.3_wp), e, 100*epsilon(e)*maxval(abs(e)), "a semigroup")
  end subroutine test_exponential

  !> By differences of rates where a system says nothing.
  subroutine test_jacobian()
    type(two_masses_t) :: masses
    type(deviations_t) :: found
    real(wp) :: expected(4, 4)
    masses%n_states = 4
    masses%mass = [1.0_wp, 2.5_wp]
    masses%stiffness = [0.4_wp, 1.3_wp]
    masses%coupling = 0.7_wp
    masses%wall_stiffness = 3
    masses%wall = [0.1_wp, -0.5_wp]
    found = deviations_of(masses)
    expected = 0
    expected(1, 2) = 1
    expected(3, 4) = 1
    expected(2, :) = [-1.1_wp, 0.0_wp, 0.7_wp, 0.0_wp]
    expected(4, :) = [0.7_wp, 0.0_wp, -2.0_wp, 0.0_wp]/2.5_wp
    call close_to(found%a(:4, :4, separation), expected, 8*epsilon(expected), "two masses apart")
    expected(2, 1) = -4.1_wp
    call close_to(found%a(:4, :4, engagement), expected, 8*epsilon(expected), "at the wall")
    call tally%is_true(.not. any(found%oscillates), "coupled: no closed form")
  end subroutine test_jacobian

  !> The gear's own closed form, to the bit; a system that is one without saying so has it too.
  subroutine test_oscillator()
    type(oscillator_t) :: gear
    type(forced_mass_t) :: mass
    type(deviations_t) :: found
    real(wp) :: m(max_states, 2), expected(2, 2)
    allocate (fixed_flank_t :: gear%path)
    gear%damping = 0.3_wp
    found = deviations_of(gear)
    m = reshape([1, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0], shape(m))
    call move_deviations(found, engagement, 1.7_wp, m)
    expected = free_matrix(damped(0.15_wp), 1.7_wp)
    call tally%is_true(all(m(:2, :) == expected), "damped oscillator")
    call tally%near(found%divergence(engagement), -0.3_wp, 0.0_wp, "divergence")
    m = reshape([1, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0], shape(m))
    call move_deviations(found, separation, 1.7_wp, m)
    call close_to(m(:2, :), reshape([1.0_wp, 0.0_wp, 1.7_wp, 1.0_wp], [2, 2]), 0.0_wp, "flight")
    found = deviations_of(mass)
    call tally%is_true(found%oscillates(separation), "a mass on a spring oscillates")
  end subroutine test_oscillator

  !> Impacts of the first of two coupled masses, and contact with a wall that is a spring.
  subroutine test_two_masses()
    type(two_masses_t) :: masses
    masses%n_states = 4
    masses%n_flanks = 1
    masses%mass = [1.0_wp, 2.5_wp]
    masses%stiffness = [0.4_wp, 1.3_wp]
    masses%coupling = 0.7_wp
    masses%law = relative_impact_t(restitution=0.8_wp)
    masses%wall(1) = 0.1_wp
    masses%period = 5
    call compare(masses, [-1.0_wp, 0.2_wp, 0.7_wp, -0.1_wp], 1, "two masses, one impact")
    masses%period = 13
    call compare(masses, [-1.0_wp, 0.2_wp, 0.7_wp, -0.1_wp], 3, "two masses, impacts")
    masses%damper = 0.3_wp
    call compare(masses, [-1.0_wp, 0.2_wp, 0.7_wp, -0.1_wp], -1, "two masses, a damper between")
    masses%law = compliant_t()
    masses%wall_stiffness = 50
    call compare(masses, [-1.0_wp, 0.2_wp, 0.7_wp, -0.1_wp], 0, "two masses, a wall that yields")
  end subroutine test_two_masses

  !> The two wheels: relative motion as of the oscillator alone, the mean one uniform beside it.
  subroutine test_chain()
    type(parameters_t) :: p
    type(torsional_chain_t) :: chain
    real(wp) :: c(0:5, 1)
    integer :: error
    real(wp), parameter :: none(3, 1) = reshape([-1.0_wp, 0.0_wp, 0.0_wp], [3, 1])
    real(wp), parameter :: y(4) = [-0.3_wp, 0.1_wp, 5.0_wp, -0.2_wp]
    c(:, 1) = [0.02_wp, 0.1_wp, -0.1_wp, -0.4_wp, 0.3_wp, 0.1_wp]
    p%force = 0.5_wp
    p%mean_acceleration = 0.3_wp
    p%mesh_frequency_ratio = 2*atan(1.0_wp)
    p%damping_ratio = 0.15_wp
    p%restitution = 0.6_wp
    p%backlash = 3
    p%tolerance = 1.0e-13_wp
    call make_torsional_chain(p, knots, c, [.true.], none, chain, error)
    call compare(chain, y, -1, "chain, relative")
    p%impact_law = law_absolute
    call make_torsional_chain(p, knots, c, [.true.], none, chain, error)
    call compare(chain, y, -1, "chain, absolute")
    p%impact_law = law_relative
    p%contact_law = law_compliant
    call make_torsional_chain(p, knots, c, [.true.], none, chain, error)
    call compare(chain, y, 0, "chain, compliant")
    p%contact_law = 1
    p%restitution = 0.3_wp
    p%force = 1.5_wp
    call make_torsional_chain(p, knots, c, [.true.], none, chain, error)
    call compare(chain, [-0.02_wp, 0.05_wp, 5.0_wp, -0.2_wp], -1, "chain, complete chatter")
  end subroutine test_chain

  !> Matrix of one cycle against central differences. The map has curvature up to some 1e2 and
  !> events are found to some 1e-13: with a difference of 1e-6 both errors are below some 1e-7.
  subroutine compare(system, y, impacts, what)
    class(system_t), intent(in) :: system    !! what moves
    real(wp), intent(in) :: y(4)             !! state at the beginning, in separation
    integer, intent(in) :: impacts           !! expected; negative: at least one
    character(*), intent(in) :: what         !! in words
    real(wp), parameter :: difference = 1.0e-6_wp, allowed = 1.0e-6_wp
    real(wp) :: end(4), row(columns), plus(4), minus(4), unused(columns), z(4), m(4, 4), found(4, 4)
    integer :: k, counted, beside
    call one_cycle(system, y, end, row, counted)
    if (impacts >= 0) call tally%equal(counted, impacts, what//": impacts")
    if (impacts < 0) call tally%is_true(counted > 0, what//": impacts")
    m = transpose(reshape(row(:16), [4, 4]))*2.0_wp**nint(row(17))
    do k = 1, 4
      z = y
      z(k) = y(k) + difference
      call one_cycle(system, z, plus, unused, beside)
      z(k) = y(k) - difference
      call one_cycle(system, z, minus, unused, beside)
      found(:, k) = (plus - minus)/(2*difference)
    end do
    call close_to(m, found, allowed*max(1.0_wp, maxval(abs(found))), what)
    if (nint(row(20)) == 4) then
      call tally%near(row(18), log(abs(determinant(m))), 1.0e-11_wp, what//": ln|det|")
    else
      call tally%equal(nint(row(20)), 3, what//": one number is lost")
      call tally%near(determinant(m), 0.0_wp, 1.0e-13_wp*maxval(abs(m))**4, &
          what//": no determinant")
    end if
  end subroutine compare

  subroutine one_cycle(system, y, end, row, impacts)
    class(system_t), intent(in) :: system            !! what moves
    real(wp), intent(in) :: y(4)                     !! state at the beginning
    real(wp), intent(out) :: end(4)                  !! phi, phi' and the others at the end
    real(wp), intent(out) :: row(columns)            !! line of the tangent map
    integer, intent(out) :: impacts                  !! impacts on the way
    type(recorder_t) :: recorder
    type(hybrid_state_t) :: state
    type(work_t) :: work
    real(wp), target :: cycles(cycle_columns, 1), rows(columns, 1)
    integer :: status
    recorder%want_cycles = .true.
    recorder%want_tangent = .true.
    recorder%deviations = deviations_of(system)
    recorder%cycles => cycles
    recorder%tangent => rows
    state%instant%y(1:4) = y
    call run_to(system, rk4_flow_t(), numerics_t(tolerance=1.0e-13_wp, &
        chatter_tolerance=1.0e-13_wp), 1, 0.0_wp, deadline_in(60.0_wp), state, recorder, work, &
        status)
    call tally%equal(status, status_ok, "run: status")
    row = rows(:, 1)
    impacts = nint(sum(cycles(5:6, 1)))
    call system%observe(state%instant, end(1), end(2))
    end(3:) = state%instant%y(3:4)
  end subroutine one_cycle

  !> By elimination, with the largest pivot.
  pure real(wp) function determinant(matrix) result(det)
    real(wp), intent(in) :: matrix(4, 4)             !! matrix
    real(wp) :: m(4, 4), row(4)
    integer :: i, k
    m = matrix
    det = 1
    do k = 1, 4
      i = k - 1 + maxloc(abs(m(k:, k)), dim=1)
      if (i /= k) then
        row = m(k, :)
        m(k, :) = m(i, :)
        m(i, :) = row
        det = -det
      end if
      det = det*m(k, k)
      if (det == 0) return
      do i = k + 1, 4
        m(i, :) = m(i, :) - m(k, :)*(m(i, k)/m(k, k))
      end do
    end do
  end function determinant

  subroutine close_to(found, expected, allowed, what)
    real(wp), intent(in) :: found(:, :)              !! what came out
    real(wp), intent(in) :: expected(:, :)           !! what should have
    real(wp), intent(in) :: allowed                  !! of each element
    character(*), intent(in) :: what                 !! in words
    integer :: i, k
    do k = 1, size(found, 2)
      do i = 1, size(found, 1)
        call tally%near(found(i, k), expected(i, k), allowed, what)
      end do
    end do
  end subroutine close_to
end program test_deviations
