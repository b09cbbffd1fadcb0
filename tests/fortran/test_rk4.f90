!> The step formula: order conditions, measured order, dense output, error estimate, dispatch.
program test_rk4
  use assertions, only: tally_t
  use lapwing_kinds, only: wp, int64
  use lapwing_codes, only: separation, engagement, back_engagement
  use lapwing_system_oscillator, only: oscillator_t
  use test_systems, only: oscillator
  use lapwing_system_parameters, only: parameters_t
  use lapwing_polynomial_evaluation, only: horner
  use lapwing_flow_rk4_step, only: rk4_step, rk4_move
  use lapwing_system_start, only: start_from
  use lapwing_system, only: instant_t, frame_t, motion_t, max_states
  use test_systems, only: swirl_t, trees_t, dispatched_t
  implicit none

  type(tally_t) :: tally

  call test_trees()
  call test_formula_order()
  call test_local_orders()
  call test_exact_in_flight()
  call test_move_is_step()
  call test_dispatch()
  call tally%finish()

contains

  !> All conditions up to order 5 for the formula, the dense output at every point and, up to order
  !> 4, the estimate: Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I, table
  !> II.2.1. A step of length 1 is a sum of some 40 products below 1, and the dense coefficients
  !> have weights up to 52: rounding is below 1000 units.
  subroutine test_trees()
    real(wp), parameter :: rounding = 1000*epsilon(1.0_wp)
    integer, parameter :: tree_order(7) = [1, 2, 3, 3, 4, 4, 4], density(7) = [1, 2, 3, 6, 4, 8, 12]
    integer, parameter :: last_density(0:9) = [24, 5, 10, 15, 30, 20, 20, 40, 60, 120]
    type(trees_t) :: trees
    type(frame_t) :: frame
    type(motion_t) :: motion
    real(wp) :: z(max_states), z_end(max_states), error(max_states), largest
    integer :: tree
    trees%n_states = 8
    z = 0
    largest = 0
    do tree = 0, 9
      trees%variant = tree
      call rk4_step(trees, frame, separation, 1.0_wp, z, motion, z_end, error)
      call check_tree(motion, z_end, 8, merge(4, 5, tree == 0), last_density(tree), rounding)
      if (tree == 0) call tally%below(error(8), rounding, "estimate, the tall tree of order 4")
      if (tree > 0) largest = max(largest, error(8))
    end do
    call tally%is_true(largest > 1.0e-4_wp, "the estimate sees the terms of order 5")
    trees%variant = 0
    call rk4_step(trees, frame, separation, 1.0_wp, z, motion, z_end, error)
    do tree = 1, 7
      call check_tree(motion, z_end, tree, tree_order(tree), density(tree), rounding)
      call tally%below(error(tree), rounding, "estimate of a tree up to order 4")
    end do
  end subroutine test_trees

  !> The dense output is (s/h)**order/density, term by term, and the end agrees.
  subroutine check_tree(motion, z_end, i, tree_order, density, rounding)
    type(motion_t), intent(in) :: motion        !! the step
    real(wp), intent(in) :: z_end(max_states)   !! its end
    integer, intent(in) :: i                    !! state variable
    integer, intent(in) :: tree_order, density  !! of the tree it stands for
    real(wp), intent(in) :: rounding            !! allowed
    character(40) :: name
    integer :: k
    write (name, "(a, i0, a, i0)") "order ", tree_order, ", density ", density
    call tally%near(z_end(i), 1.0_wp/density, rounding, "formula, tree of "//trim(name))
    do k = 0, ubound(motion%dense, 1)
      call tally%near(motion%dense(k, i), merge(1.0_wp/density, 0.0_wp, k == tree_order), &
          rounding, "dense output, tree of "//trim(name))
    end do
  end subroutine check_tree

  !> Exact solution of `swirl_t` through (1, 0) at t = 0.
  pure function swirl_exact(t) result(y)
    real(wp), intent(in) :: t   !! time
    real(wp) :: y(2)
    y = [cos(t + t**2/2), sin(t + t**2/2)]
  end function swirl_exact

  !> Error at t = 1 after n steps.
  real(wp) function swirl_error(n)
    integer, intent(in) :: n    !! steps
    type(swirl_t) :: swirl
    type(frame_t) :: frame
    real(wp) :: z(max_states), z_end(max_states)
    integer :: i
    z = 0
    z(1:2) = swirl_exact(0.0_wp)
    do i = 1, n
      frame%t = (i - 1)/real(n, wp)
      call rk4_move(swirl, frame, separation, 1/real(n, wp), z, z_end)
      z(1:2) = z_end(1:2)
    end do
    swirl_error = norm2(z(1:2) - swirl_exact(1.0_wp))
  end function swirl_error

  !> Halving the step divides the error by 32 (fifth order, as extrapolated). The next term of the
  !> expansion shifts the exponent by O(h), 0.46 and then 0.20 here: extrapolated once more that
  !> leaves O(h**2), below 0.46*0.20.
  subroutine test_formula_order()
    real(wp) :: error(3), slope(2)
    integer :: i
    error = [(swirl_error(2**i), i = 5, 7)]
    slope = log(error(1:2)/error(2:3))/log(2.0_wp)
    print "(a, 2f7.3, a, es9.2)", "formula: order ", slope, ", error at 1/128 ", error(3)
    call tally%near(2*slope(2) - slope(1), 5.0_wp, 0.1_wp, "order of the formula")
  end subroutine test_formula_order

  !> One step from t = 0.3: largest error of the dense output over it, estimate, error at its end.
  subroutine one_step(h, dense_error, estimate, end_error)
    real(wp), intent(in) :: h                                   !! step
    real(wp), intent(out) :: dense_error, estimate, end_error   !! in the first coordinate
    type(swirl_t) :: swirl
    type(frame_t) :: frame
    type(motion_t) :: motion
    real(wp) :: z(max_states), z_end(max_states), error(max_states), exact(2)
    integer :: i
    frame%t = 0.3_wp
    z = 0
    z(1:2) = swirl_exact(frame%t)
    call rk4_step(swirl, frame, separation, h, z, motion, z_end, error)
    dense_error = 0
    do i = 0, 20
      exact = swirl_exact(frame%t + h*i/20.0_wp)
      dense_error = max(dense_error, abs(horner(motion%dense(:, 1), i/20.0_wp) - exact(1)))
    end do
    estimate = error(1)
    end_error = abs(z_end(1) - exact(1))
    call tally%near(sum(motion%dense(:, 1)), z_end(1), 50*epsilon(h), "dense output at the end")
  end subroutine one_step

  !> Over one step the errors of formula and dense output fall as h**6 (fifth order), the estimate
  !> as h**5. Exponents are off by O(h), h = 0.02 times ratios of derivatives below 20.
  subroutine test_local_orders()
    real(wp) :: dense(2), estimate(2), at_end(2), slope(3)
    call one_step(0.04_wp, dense(1), estimate(1), at_end(1))
    call one_step(0.02_wp, dense(2), estimate(2), at_end(2))
    slope = log([dense(1)/dense(2), at_end(1)/at_end(2), estimate(1)/estimate(2)])/log(2.0_wp)
    print "(a, 3f7.3)", "one step: orders of dense output, end, estimate ", slope
    print "(a, 3es10.2)", "at h = 0.02: errors dense, end, estimate ", dense(2), at_end(2), &
        estimate(2)
    call tally%near(slope(1), 6.0_wp, 0.4_wp, "local order of the dense output")
    call tally%near(slope(2), 6.0_wp, 0.4_wp, "local order of the formula")
    call tally%near(slope(3), 5.0_wp, 0.4_wp, "order of the estimate")
    call tally%below(dense(2), estimate(2), "the estimate bounds the error of the step")
  end subroutine test_local_orders

  !> A flight is a parabola: no error, and the estimate says so exactly.
  subroutine test_exact_in_flight()
    type(oscillator_t) :: gear
    type(frame_t) :: frame
    type(motion_t) :: motion
    type(instant_t) :: instant
    real(wp) :: z(max_states), z_end(max_states), error(max_states), h
    gear = some_gear()
    instant = start_from(gear, 0.1_wp, separation, -0.5_wp, -0.25_wp)
    call gear%open_frame(instant, frame)
    z = instant%y
    h = 0.7_wp
    call rk4_step(gear, frame, separation, h, z, motion, z_end, error)
    call tally%below(maxval(error(1:2)), 0.0_wp, "estimate in flight")
    call tally%near(z_end(1), z(1) + h*z(2) + gear%force*h**2/2, 20*epsilon(h), "flight")
  end subroutine test_exact_in_flight

  !> Both entries give the same bytes.
  subroutine test_move_is_step()
    type(swirl_t) :: swirl
    type(frame_t) :: frame
    type(motion_t) :: motion
    real(wp) :: z(max_states), z_end(max_states), z_move(max_states), error(max_states)
    z = 0
    z(1:2) = swirl_exact(0.2_wp)
    call rk4_step(swirl, frame, separation, 0.137_wp, z, motion, z_end, error)
    call rk4_move(swirl, frame, separation, 0.137_wp, z, z_move)
    call tally%is_true(same_bytes(z_end(1:2), z_move(1:2)), "rk4_move ends as rk4_step")
  end subroutine test_move_is_step

  !> The formula and the gear's own stages: the same to rounding in every motion state, in
  !> steps inside a piece and over several.
  subroutine test_dispatch()
    type(oscillator_t) :: gear
    type(dispatched_t) :: slow
    type(instant_t) :: instant
    type(frame_t) :: frame
    type(motion_t) :: fast_motion, slow_motion
    real(wp) :: z(max_states), fast(max_states), by_dispatch(max_states)
    real(wp) :: fast_error(max_states), error(max_states)
    real(wp) :: phi
    integer :: i, motion_state
    gear = some_gear()
    slow%inner = gear
    do i = 0, 99
      motion_state = mod(i, 3)
      phi = merge(-1.2_wp, merge(0.3_wp, -0.4_wp, motion_state == engagement), &
          motion_state == back_engagement)
      instant = start_from(gear, 0.01_wp*i, motion_state, phi, 0.01_wp*i)
      call gear%open_frame(instant, frame)
    z = instant%y
      call rk4_step(gear, frame, motion_state, 0.9_wp*frame%stop, z, fast_motion, fast, fast_error)
      call rk4_step(slow, frame, motion_state, 0.9_wp*frame%stop, z, slow_motion, by_dispatch, &
          error)
      ! Coordinates and rates stay below 4, weights of the dense output below 52.
      call tally%below(maxval(abs(fast_motion%dense - slow_motion%dense)), 1000*epsilon(phi), &
          "dispatch: dense output")
      call tally%below(maxval(abs(fast(1:2) - by_dispatch(1:2))), 40*epsilon(phi), &
          "dispatch: end of step")
      call tally%below(maxval(abs(fast_error(1:2) - error(1:2))), 40*epsilon(phi), &
          "dispatch: error")
    end do
  end subroutine test_dispatch

  !> An oscillator whose table has pieces, kinks and curvature.
  function some_gear() result(gear)
    type(oscillator_t) :: gear
    type(parameters_t) :: p
    real(wp) :: c(0:5, 3)
    p%force = 0.7_wp
    p%mesh_frequency_ratio = 1.3_wp
    p%damping_ratio = 0.1_wp
    p%peak_to_peak = 0.3_wp
    p%tolerance = 1
    c = 0
    c(0:3, 1) = [0.1_wp, 0.2_wp, 0.3_wp, -0.1_wp]
    c(0:3, 2) = [0.15_wp, -0.1_wp, 0.2_wp, 0.4_wp]
    c(0:3, 3) = [0.12_wp, 0.3_wp, -0.2_wp, 0.1_wp]
    gear = oscillator(p, [0.0_wp, 0.3_wp, 0.55_wp, 1.0_wp], c, [.false., .false., .true.])
  end function some_gear

  logical function same_bytes(x, y)
    real(wp), intent(in) :: x(:), y(:)   !! numbers
    same_bytes = all(transfer(x, [0_int64]) == transfer(y, [0_int64]))
  end function same_bytes
end program test_rk4
