!> Polynomials: values and shifts by hand, every root isolated.
program test_polynomial
  use, intrinsic :: iso_fortran_env, only: real128
  use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
  use assertions, only: tally_t
  use lapwing_kinds, only: wp
  use lapwing_polynomial_evaluation, only: max_degree, horner, horner_slope, value_and_slope, jet, &
      taylor_shift, bernstein, never_below, least, largest
  use lapwing_polynomial_roots, only: first_zero, first_descent, critical_points, lift_off, &
      parabola_descent, raise_to_largest
  implicit none

  !> Rounding of a degree-five polynomial in Horner's scheme is at most 2*degree units of roundoff
  !> of sum |c_k| x**k; building the coefficients from roots, scaling to the unit interval and the
  !> Bernstein sums (whose weights are positive) each cost about as much again.
  real(wp), parameter :: rounding = 4*2*max_degree*epsilon(1.0_wp)
  type(tally_t) :: tally

  call test_values()
  call test_lift_off()
  call test_single_roots()
  call test_clusters()
  call test_touches()
  call test_close_pairs()
  call test_tiny_roots()
  call test_end_of_interval()
  call test_no_root()
  call test_not_a_number()
  call test_parabolas()
  call test_top_of_a_parabola()
  call test_critical_points()
  call tally%finish()

contains

  !> 1 + 2x - 3x**2 + x**5 and what follows from it by hand; small integers, hence exact.
  subroutine test_values()
    real(wp) :: c(0:5), b(0:5), high(0:15), value, slope, bend
    c = [1.0_wp, 2.0_wp, -3.0_wp, 0.0_wp, 0.0_wp, 1.0_wp]
    call value_and_slope(c, 2.0_wp, value, slope)
    call tally%near(value, 25.0_wp, 0.0_wp, "value with slope")
    call tally%near(slope, 70.0_wp, 0.0_wp, "slope with value")
    ! 1 + x (2 + x (-3 + ...)), where -3 + x**3 is not below -3: 2 - 3 = -1, 1 - 1 = 0.
    call tally%near(never_below(c), 0.0_wp, 0.0_wp, "never below")
    call tally%near(never_below(-c), -3.0_wp, 0.0_wp, "never below, of the opposite")
    call tally%near(horner(c, 2.0_wp), 25.0_wp, 0.0_wp, "horner")
    call tally%near(horner_slope(c, 2.0_wp), 70.0_wp, 0.0_wp, "horner_slope")
    call tally%near(horner(c(0:0), 2.0_wp), 1.0_wp, 0.0_wp, "horner of a constant")
    call tally%near(horner_slope(c(0:1), 7.0_wp), 2.0_wp, 0.0_wp, "slope of a line")
    call jet(5, c, 2.0_wp, value, slope, bend)
    call tally%below(maxval(abs([value, slope, bend] - [25, 70, 77])), 0.0_wp, "jet")
    call tally%near(least(c), -3.0_wp, 0.0_wp, "least coefficient")
    call tally%near(largest(c), 2.0_wp, 0.0_wp, "largest coefficient")
    high = 0
    high(14:15) = [3.0_wp, 1.0_wp]
    call jet(15, high, 2.0_wp, value, slope, bend)
    call tally%below(maxval(abs([value, slope, bend] &
        - [81920, 15*16384 + 42*8192, 105*8192 + 273*4096])), 0.0_wp, "jet of degree 15")
    call taylor_shift(c, 2.0_wp)
    call tally%below(maxval(abs(c - [25, 70, 77, 40, 10, 1])), &
        0.0_wp, "taylor_shift")
    ! x**k has b_j = C(j, k)/C(5, k): binomials over 5 and 10, one rounding each of a value <= 1.
    b = bernstein([0.0_wp, 1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp])
    call tally%below(maxval(abs(5*b - [0, 1, 2, 3, 4, 5])), 5*4*epsilon(1.0_wp), "bernstein of x")
    b = bernstein([0.0_wp, 0.0_wp, 1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp])
    call tally%below(maxval(abs(10*b - [0, 0, 1, 3, 6, 10])), 10*4*epsilon(1.0_wp), &
        "bernstein of x**2")
    b = bernstein([3.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, -3.0_wp])
    call tally%below(maxval(abs(b - [3, 3, 3, 3, 3, 0])), 0.0_wp, "bernstein of 3 - 3x**5")
  end subroutine test_values

  !> A polynomial that begins at zero and rises is divided by x until it is positive.
  subroutine test_lift_off()
    real(wp) :: c(0:5)
    integer :: times
    c = [0.0_wp, 0.0_wp, 2.0_wp, -1.0_wp, 0.0_wp, 4.0_wp]
    call lift_off(c, times)
    call tally%equal(times, 2, "lift_off divisions")
    call tally%below(maxval(abs(c - [2, -1, 0, 4, 0, 0])), 0.0_wp, "lift_off coefficients")
    c = [1.0_wp, -1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp]
    call lift_off(c, times)
    call tally%equal(times, 0, "lift_off of a positive one")
    c = 0
    call lift_off(c, times)
    call tally%equal(times, max_degree + 1, "lift_off of nothing")
  end subroutine test_lift_off

  !> Roots anywhere, of any sign, at least 1e-3 apart: the first one is met to its conditioning.
  subroutine test_single_roots()
    real(wp) :: roots(5), c(0:5), x, length
    logical :: found
    integer :: i, degree
    call seed_random()
    do i = 1, 20000
      degree = 1 + mod(i, 5)
      call random_number(roots)
      roots = 4*roots - 1
      length = 1 + 2*random()
      if (least_distance(roots(1:degree)) < 1.0e-3_wp) cycle
      if (minval(abs(roots(1:degree))) < 1.0e-3_wp) cycle
      if (minval(abs(roots(1:degree) - length)) < 1.0e-6_wp) cycle
      call from_roots(roots(1:degree), c)
      call first_zero(c, length, found, x)
      call check_first(roots(1:degree), length, found, x)
    end do
  end subroutine test_single_roots

  !> The first positive root up to `length` and no other, within rounding over slope.
  subroutine check_first(roots, length, found, x)
    real(wp), intent(in) :: roots(:)   !! all roots, simple
    real(wp), intent(in) :: length     !! interval
    logical, intent(in) :: found       !! outcome
    real(wp), intent(in) :: x          !! outcome
    real(wp) :: first, slope
    integer :: i
    first = minval(roots, roots > 0 .and. roots <= length)
    call tally%is_true(found .eqv. first <= length, "a simple root is found or not")
    if (.not. (found .and. first <= length)) return
    slope = 1
    do i = 1, size(roots)
      if (roots(i) /= first) slope = slope*abs(first - roots(i))
    end do
    call tally%near(x, first, rounding*product(abs(first) + abs(roots))/slope, "simple root")
  end subroutine check_first

  !> Roots within 1e-2 .. 1e-9 of each other: checked by what a computer can know (`check_sign`).
  subroutine test_clusters()
    real(wp) :: roots(5), c(0:5), x
    logical :: found
    integer :: i
    do i = 1, 5000
      call random_number(roots)
      roots = 0.1_wp + 0.8_wp*random() + (roots - 0.5_wp)*10.0_wp**(-2 - mod(i, 8))
      if (mod(i, 3) == 0) roots(4:5) = [-random(), 1 + random()]
      call from_roots(roots, c)
      call first_zero(c, 1.0_wp, found, x)
      ! An odd number of the roots lies inside: the sign changes, so something must be found.
      if (mod(i, 3) /= 0) call tally%is_true(found, "a cluster of five is found")
      if (mod(i, 3) == 0) call tally%is_true(found, "a cluster of three is found")
      call check_sign(c, 1.0_wp, found, x)
    end do
  end subroutine test_clusters

  !> Double roots: rounding may or may not see them, but must not see them elsewhere, nor miss the
  !> crossing that follows.
  subroutine test_touches()
    real(wp) :: touch, crossing, c(0:5), x
    logical :: found
    integer :: i
    do i = 1, 2000
      touch = 0.05_wp + 0.4_wp*random()
      crossing = 0.55_wp + 0.4_wp*random()
      call from_roots([touch, touch, crossing, -random()], c)
      call first_zero(c, 1.0_wp, found, x)
      call tally%is_true(found, "a crossing after a touch")
      call check_sign(c, 1.0_wp, found, x)
      ! Half of the digits: rounding/curvature under a square root, curvature/scale > 1e-2 here.
      call tally%below(min(abs(x - touch), abs(x - crossing)), sqrt(100*rounding), "touch")
      call from_roots([touch, touch], c)
      call first_zero(c, 1.0_wp, found, x)
      call check_sign(c, 1.0_wp, found, x)
      if (found) call tally%near(x, touch, sqrt(100*rounding), "a touch alone")
    end do
    ! p = (x - 1/2)**2 is exact in binary: it must be reported where it is below rounding.
    call first_zero([0.25_wp, -1.0_wp, 1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp], 1.0_wp, found, x)
    call tally%is_true(found, "an exact touch")
    call tally%near(x, 0.5_wp, sqrt(epsilon(x)), "an exact touch")
  end subroutine test_touches

  !> Pairs 1e-12 apart: near the middle the dip of 2.5e-25 is below rounding and either answer is
  !> right; close to the origin, where coefficients keep relative precision, it must be seen.
  subroutine test_close_pairs()
    real(wp) :: c(0:5), x, at
    logical :: found
    integer :: i
    do i = 1, 1000
      at = 0.05_wp + 0.9_wp*random()
      call from_roots([at, at + 1.0e-12_wp, 2.0_wp], c)
      call first_zero(c, 1.0_wp, found, x)
      call check_sign(c, 1.0_wp, found, x)
      if (found) call tally%near(x, at, sqrt(100*rounding), "close pair")
      at = (1 + random())*1.0e-12_wp
      call from_roots([at, at + 1.0e-12_wp, 2.0_wp], c)
      call first_zero(c, 1.0_wp, found, x)
      call tally%is_true(found, "close pair at the origin is seen")
      ! Conditioning (2 at)(at + at + 1e-12)/1e-12 of at: at most 20 at.
      call tally%near(x, at, 20*rounding*at, "close pair at the origin")
    end do
  end subroutine test_close_pairs

  !> A root at 1e-10 (and down to 1e-14) of the interval keeps its relative precision.
  subroutine test_tiny_roots()
    real(wp) :: c(0:5), x, tiny_root
    logical :: found
    integer :: i
    do i = 1, 1000
      tiny_root = (1 + random())*10.0_wp**(-8 - mod(i, 7))
      call from_roots([tiny_root, 0.5_wp + random(), -random() - 0.1_wp, 1 + random()], c)
      call first_zero(c, 1.0_wp, found, x)
      call tally%is_true(found, "tiny root is found")
      call tally%near(x, tiny_root, 4*rounding*tiny_root, "tiny root")
    end do
  end subroutine test_tiny_roots

  !> The interval is (0, length]: its end belongs to it, as far as the last Bernstein coefficient is
  !> exact. Where it is not (the weights 1/5 and 1/10 are rounded), a root inside by some units of
  !> rounding over slope must be found, one outside by as much must not.
  subroutine test_end_of_interval()
    real(wp), parameter :: c(0:5, 3) = reshape([ &
        1.0_wp, -1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, &
        1.0_wp, 0.0_wp, -1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, &
        2.0_wp, -3.0_wp, 1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp], [6, 3])
    real(wp) :: x
    logical :: found
    integer :: i
    call first_zero([3.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, -3.0_wp], 1.0_wp, found, x)
    call tally%is_true(found, "root exactly at the end of the interval")
    call tally%near(x, 1.0_wp, 0.0_wp, "root exactly at the end")
    call first_zero([64.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, -2.0_wp], 2.0_wp, found, x)
    call tally%is_true(found, "root exactly at the end of a longer interval")
    call tally%near(x, 2.0_wp, 0.0_wp, "root exactly at the end of a longer interval")
    do i = 1, 3
      ! Each has the root 1 with slope -1 or -2 and sizes up to 6.
      call first_zero(c(:, i), 1 + 6*rounding, found, x)
      call tally%is_true(found, "a root just inside the end is found")
      call tally%near(x, 1.0_wp, 6*rounding, "a root just inside the end")
      call first_zero(c(:, i), 1 - 6*rounding, found, x)
      call tally%is_true(.not. found, "a root just beyond the end is not found")
    end do
  end subroutine test_end_of_interval

  !> All roots complex, negative or beyond the interval.
  subroutine test_no_root()
    real(wp) :: c(0:5), x, pair(0:2), quartic(0:4)
    logical :: found
    integer :: i, k
    do i = 1, 2000
      quartic = [1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp]
      do k = 0, 1
        ! |x - (a + ib)|**2 with b at least 1e-6: the least value is far above rounding.
        pair(1) = -2*random()
        pair(0) = 0.25_wp*pair(1)**2 + max(random(), 1.0e-6_wp)*10.0_wp**(-mod(i, 6))
        quartic = quartic*pair(0) + pair(1)*[0.0_wp, quartic(0:3)] + [0.0_wp, 0.0_wp, quartic(0:2)]
      end do
      c = [quartic, 0.0_wp]*(1 + random()) + [0.0_wp, quartic]
      call first_zero(c, 1.0_wp, found, x)
      call check_sign(c, 1.0_wp, found, x)
      if (mod(i, 6) <= 2) call tally%is_true(.not. found, "no root")
    end do
  end subroutine test_no_root

  !> Not a number, anywhere, is no root and no endless loop. Traps are off for the comparison.
  subroutine test_not_a_number()
    use, intrinsic :: ieee_exceptions, only: ieee_set_halting_mode, ieee_invalid, ieee_set_flag
    real(wp) :: c(0:5), x
    logical :: found
    integer :: i
    call ieee_set_halting_mode(ieee_invalid, .false.)
    do i = 0, 5
      c = [1.0_wp, -3.0_wp, 1.0_wp, 0.0_wp, 1.0_wp, 1.0_wp]
      c(i) = ieee_value(x, ieee_quiet_nan)
      call first_zero(c, 1.0_wp, found, x)
      call tally%is_true(.not. found, "not a number is no root")
    end do
    call ieee_set_flag(ieee_invalid, .false.)
    call ieee_set_halting_mode(ieee_invalid, .true.)
  end subroutine test_not_a_number

  !> Extrema of a polynomial whose slope has known roots; a saddle is none.
  subroutine test_critical_points()
    real(wp) :: slope(0:5), c(0:5), at(max_degree)
    integer :: n, k
    call from_roots([0.2_wp, 0.7_wp, 1.5_wp, -1.0_wp], slope)
    c = [5.0_wp, (slope(k)/(k + 1), k = 0, 4)]
    call critical_points(c, 1.0_wp, n, at)
    call tally%equal(n, 2, "two extrema inside")
    ! Rounding over slope: product(0.2 + |roots|)/product of distances < 3, and the second root is
    ! searched from the first, which adds its error.
    call tally%near(at(1), 0.2_wp, 10*rounding, "first extremum")
    call tally%near(at(2), 0.7_wp, 10*rounding, "second extremum")
    call from_roots([0.1_wp, 0.2_wp, 0.8_wp, 0.9_wp], slope)
    c = [0.0_wp, (-slope(k)/(k + 1), k = 0, 4)]
    call critical_points(c, 1.0_wp, n, at)
    call tally%equal(n, 4, "four extrema")
    call tally%below(maxval(abs(at(1:4) - [0.1_wp, 0.2_wp, 0.8_wp, 0.9_wp])), 100*rounding, &
        "four extrema")
    call critical_points([1.0_wp, 1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp], 1.0_wp, n, at)
    call tally%equal(n, 0, "a line has no extremum")
    call critical_points([1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp], 1.0_wp, n, at)
    call tally%equal(n, 0, "a constant has no extremum")
    call critical_points([0.0_wp, 0.0_wp, -1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp], 1.0_wp, n, at)
    call tally%equal(n, 0, "an extremum at the beginning is not inside")
    call critical_points([0.0_wp, 0.0_wp, -1.0_wp, 1.0_wp, 0.0_wp, 0.0_wp], 1.0_wp, n, at)
    call tally%equal(n, 1, "one extremum after one at the beginning")
    if (n == 1) call tally%near(at(1), 2.0_wp/3, rounding, "extremum of -x**2 + x**3")
  end subroutine test_critical_points

  !> What a computer can know: before the zero the polynomial is not negative beyond rounding, and
  !> at it not different from zero beyond rounding. In quadruple precision. The unit of rounding
  !> is that of the Bernstein coefficients on the whole interval, sum |c_k| length**k.
  subroutine check_sign(c, length, found, x)
    real(wp), intent(in) :: c(0:5)     !! coefficients
    real(wp), intent(in) :: length     !! interval
    logical, intent(in) :: found       !! outcome
    real(wp), intent(in) :: x          !! outcome
    integer, parameter :: samples = 200
    real(wp) :: at, last, worst
    integer :: i
    last = merge(x, length, found)
    worst = 0
    do i = 0, samples
      at = last*(real(i, wp)/samples)
      worst = max(worst, real(-exact(c, at)/exact(abs(c), length), wp))
    end do
    call tally%below(worst, rounding, "negative before the zero, over the size")
    if (found) call tally%below(real(abs(exact(c, x))/exact(abs(c), length), wp), rounding, &
        "value at the zero, over the size")
  end subroutine check_sign

  !> Value in quadruple precision.
  real(real128) function exact(c, x)
    real(wp), intent(in) :: c(0:5)     !! coefficients
    real(wp), intent(in) :: x          !! argument
    integer :: k
    exact = c(5)
    do k = 4, 0, -1
      exact = exact*x + c(k)
    end do
  end function exact

  !> Polynomial with given roots, positive at 0, rounded once from quadruple precision.
  subroutine from_roots(roots, c)
    real(wp), intent(in) :: roots(:)   !! at most five
    real(wp), intent(out) :: c(0:5)    !! coefficients
    real(real128) :: exactly(0:5)
    integer :: i
    exactly = 0
    exactly(0) = 1
    do i = 1, size(roots)
      exactly = [0.0_real128, exactly(0:4)] - roots(i)*exactly
    end do
    c = real(sign(1.0_real128, exactly(0))*exactly, wp)
  end subroutine from_roots

  real(wp) function least_distance(x)
    real(wp), intent(in) :: x(:)   !! numbers
    integer :: i, k
    least_distance = huge(1.0_wp)
    do i = 1, size(x)
      do k = 1, i - 1
        least_distance = min(least_distance, abs(x(i) - x(k)))
      end do
    end do
  end function least_distance

  real(wp) function random()
    call random_number(random)
  end function random

  !> The same numbers at every run.
  subroutine seed_random()
    integer :: n
    call random_seed(size=n)
    call random_seed(put=spread(20240229, 1, n))
  end subroutine seed_random

  !> By formula and by isolation: the same crossings, wherever they are not decided by rounding, and
  !> a value there that is zero to the rounding of its terms.
  subroutine test_parabolas()
    real(wp) :: c(0:5), general(0:5), length, at, other, terms, scale
    logical :: found, found_other, leaves
    integer :: i
    real(wp), parameter :: sizes(0:5) = [1.0_wp, 1.0e-3_wp, 1.0e-8_wp, 1.0e-14_wp, 1.0e5_wp, 1.0_wp]
    do i = 1, 30000
      c = 0
      scale = sizes(mod(i, 6))
      length = scale*(0.1_wp + random())
      c(0:2) = [random(), (6*random() - 4)/scale, (6*random() - 3)/scale**2]
      leaves = mod(i, 4) == 0
      if (leaves .or. mod(i, 11) == 0) c(0) = 0
      general = c
      call parabola_descent(c(0:2), length, leaves, found, at)
      call first_descent(general, length, leaves, found_other, other)
      if (abs(c(1)**2 - 4*c(2)*c(0)) < 1.0e-6_wp*c(1)**2 .and. c(0) > 0) cycle
      if (abs(other - length) < 1.0e-9_wp*length) cycle
      call tally%is_true(found .eqv. found_other, "a parabola is left where isolation leaves it")
      if (.not. found) cycle
      call tally%is_true(at >= 0 .and. at <= length, "within the interval")
      terms = abs(c(0)) + abs(c(1))*at + abs(c(2))*at**2
      ! Four roundings of the discriminant's terms, its root, a sum and a quotient.
      call tally%below(real(abs(c(0) + (c(1) + c(2)*real(at, real128))*real(at, real128)), wp), &
          8*epsilon(at)*terms, "zero of a parabola")
      call tally%near(at, other, 1.0e-9_wp*length, "the same zero")
    end do
    call parabola_descent([1.0_wp, -2.0_wp, 1.0_wp], 2.0_wp, .false., found, at)
    call tally%is_true(found .and. at == 1, "a touch counts")
    call parabola_descent([1.0_wp, -2.0_wp, 1.0001_wp], 2.0_wp, .false., found, at)
    call tally%is_true(.not. found, "a miss does not")
    call parabola_descent([1.0_wp, 0.0_wp, -1.0_wp], 1.0_wp, .false., found, at)
    call tally%is_true(found .and. at == 1, "the end counts")
    call parabola_descent([huge(1.0_wp), -1.0_wp, -1.0_wp], 1.0_wp, .false., found, at)
    call tally%is_true(.not. found, "what is out of reach is not met")
    call parabola_descent([0.0_wp, -1.0e-20_wp, 1.0_wp], 1.0_wp, .true., found, at)
    call tally%is_true(.not. found, "a decided departure is not undone by rounding")
  end subroutine test_parabolas

  !> Its largest value is at an end or at the top.
  subroutine test_top_of_a_parabola()
    real(wp) :: c(0:5), length, most, sampled
    integer :: i, k
    do i = 1, 300
      c = 0
      c(0:2) = [random() - 0.5_wp, 4*random() - 2, 4*random() - 2]
      length = 0.1_wp + random()
      most = -1
      call raise_to_largest(c, length, most)
      sampled = -1
      do k = 0, 1000
        sampled = max(sampled, horner(c, k*length/1000))
      end do
      ! Between samples a parabola rises by no more than c(2) (length/2000)**2.
      call tally%near(most, sampled, 2*(length/2000)**2 + rounding*5, "top of a parabola")
      call tally%is_true(most >= sampled - rounding*5, "no sample is higher")
    end do
  end subroutine test_top_of_a_parabola
end program test_polynomial
