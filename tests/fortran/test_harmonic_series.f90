!> Harmonic series: values, derivatives and bounds against sums in quadruple precision, the steady
!> response against the equation it solves.
program test_harmonic_series
  use assertions, only: tally_t
  use exact_reference, only: qp, seed, uniform, random_series
  use lapwing_flank_series, only: harmonic_series_t, harmonic_series, steady_response, series_at, &
      expand_series, derivative_series, bound_derivative, fastest_rate, top_order
  use lapwing_kinds, only: wp
  implicit none

  type(tally_t) :: tally
  real(wp), parameter :: eps = epsilon(1.0_wp)
  real(wp), parameter :: omega = 0.37_wp

  call seed(20261122)
  call test_values()
  call test_response_equation()
  call test_gain()
  call test_derivatives()
  call test_bounds()
  call test_constant()
  call tally%finish()

contains

  !> k-th derivative over k! of sum amplitude*cos(order*Omega*t + shift).
  function direct(terms, t, k) result(value)
    real(wp), intent(in) :: terms(:, :)     !! order, amplitude, shift
    real(wp), intent(in) :: t               !! time
    integer, intent(in) :: k                !! derivative
    real(qp) :: value, rate, factor
    integer :: i, j
    value = 0
    do i = 1, size(terms, 2)
      rate = terms(1, i)*omega
      factor = terms(2, i)
      do j = 1, k
        factor = factor*rate/j
      end do
      value = value + factor*cos(rate*t + terms(3, i) + k*2*atan(1.0_qp))
    end do
  end function direct

  !> Sum of the sizes of the terms of `direct`; angles round by a few EPS of themselves.
  real(wp) function rounding(terms, t, k)
    real(wp), intent(in) :: terms(:, :)     !! order, amplitude, shift
    real(wp), intent(in) :: t               !! time
    integer, intent(in) :: k                !! derivative
    integer :: i
    rounding = 0
    do i = 1, size(terms, 2)
      rounding = rounding + abs(terms(2, i))*(terms(1, i)*omega)**k/gamma(k + 1.0_wp) &
          *(k + 8 + 2*terms(1, i)*omega*t)*eps
    end do
  end function rounding

  subroutine test_values()
    real(wp) :: terms(3, 5), t, x, slope, taylor(0:top_order)
    type(harmonic_series_t) :: g
    integer :: i, k
    do i = 1, 200
      terms = random_series(4)
      g = harmonic_series(terms, 1.0_wp, omega)
      t = uniform(0.0_wp, 17.0_wp)
      call series_at(g, t, x, slope)
      call tally%near(x, real(direct(terms, t, 0), wp), rounding(terms, t, 0), "value")
      call tally%near(slope, real(direct(terms, t, 1), wp), rounding(terms, t, 1), "slope")
      call expand_series(g, t, top_order, taylor)
      do k = 0, top_order
        call tally%near(taylor(k), real(direct(terms, t, k), wp), rounding(terms, t, k), &
            "Taylor coefficient")
      end do
      call expand_series(g, t, 5, taylor(0:5))
      call tally%near(taylor(5), real(direct(terms, t, 5), wp), rounding(terms, t, 5), &
          "Taylor coefficients up to five")
      call series_at(harmonic_series(terms, -1.28_wp, omega), t, x, slope)
      call tally%near(x, -1.28_wp*real(direct(terms, t, 0), wp), 2*rounding(terms, t, 0), "scale")
    end do
  end subroutine test_values

  !> q'' + 2 xi q' + q + g'' = 0 and its derivatives, at any time.
  subroutine test_response_equation()
    real(wp), parameter :: ratios(5) = [0.0_wp, 0.1_wp, 1.0_wp, 1 + 1.0e-9_wp, 3.0_wp]
    real(wp) :: terms(3, 4), t, q(0:top_order), g(0:top_order), residual, size
    type(harmonic_series_t) :: flank, response
    integer :: i, k
    do i = 1, 100
      terms = random_series(3)
      flank = harmonic_series(terms, 1.0_wp, omega)
      associate (xi => ratios(1 + mod(i, 5)))
        response = steady_response(flank, xi)
        t = uniform(0.0_wp, 17.0_wp)
        call expand_series(flank, t, top_order, g)
        call expand_series(response, t, top_order, q)
        do k = 0, top_order - 2
          residual = (k + 2)*(k + 1)*(q(k + 2) + g(k + 2)) + 2*xi*(k + 1)*q(k + 1) + q(k)
          size = (k + 2)*(k + 1)*(bound_derivative(response, k + 2) &
              + bound_derivative(flank, k + 2)) + 2*xi*(k + 1)*bound_derivative(response, k + 1) &
              + bound_derivative(response, k)
          call tally%below(abs(residual), (k + 16)*eps*size, "equation of the steady response")
        end do
      end associate
    end do
  end subroutine test_response_equation

  !> One harmonic of rate r: amplitude r**2/sqrt((1 - r**2)**2 + (2 xi r)**2).
  subroutine test_gain()
    type(harmonic_series_t) :: response
    real(wp), parameter :: xi = 0.2_wp, rate = 3*omega
    response = steady_response(harmonic_series(reshape([3.0_wp, 2.0_wp, 0.7_wp], [3, 1]), &
        1.0_wp, omega), xi)
    call tally%near(hypot(response%cosine(1), response%sine(1)), &
        2*rate**2/sqrt((1 - rate**2)**2 + (2*xi*rate)**2), 16*eps, "gain")
    call tally%is_true(response%constant == 0, "no mean deflection from the flank alone")
  end subroutine test_gain

  subroutine test_derivatives()
    real(wp) :: terms(3, 4), t, c(0:top_order), d(0:top_order)
    integer :: i, k
    terms = random_series(3)
    do i = 0, 4, 2
      t = uniform(0.0_wp, 17.0_wp)
      call expand_series(harmonic_series(terms, 1.0_wp, omega), t, top_order, c)
      if (i == 0) c(0) = c(0) - terms(2, 1)*cos(terms(3, 1))
      call expand_series(derivative_series(harmonic_series(terms, 1.0_wp, omega), i), t, &
          top_order, d)
      do k = 0, top_order - i
        call tally%near(d(k), c(k + i)*gamma(k + i + 1.0_wp)/gamma(k + 1.0_wp), 20*eps, &
            "series of a derivative")
      end do
    end do
  end subroutine test_derivatives

  !> Above every sample, and reached by one term.
  subroutine test_bounds()
    real(wp) :: terms(3, 4), c(0:top_order), most(0:top_order)
    type(harmonic_series_t) :: g
    integer :: i, k
    terms = random_series(3)
    terms(2, 1) = 0
    g = harmonic_series(terms, 1.0_wp, omega)
    do i = 1, 2000
      call expand_series(g, 0.01_wp*i, top_order, c)
      do k = 0, top_order
        call tally%below(abs(c(k)), bound_derivative(g, k)*(1 + 8*eps), "bound of a derivative")
      end do
    end do
    g = harmonic_series(terms(:, 4:4), 1.0_wp, omega)
    most = 0
    do i = 1, 2000
      call expand_series(g, 0.003_wp*i, top_order, c)
      most = max(most, abs(c))
    end do
    do k = 0, top_order
      call tally%below(bound_derivative(g, k), most(k)*1.0001_wp, "bound of one term")
    end do
    call tally%near(fastest_rate(g), 3*omega, 2*eps, "fastest rate")
  end subroutine test_bounds

  subroutine test_constant()
    type(harmonic_series_t) :: g
    real(wp) :: x, slope, taylor(0:5)
    g = harmonic_series(reshape([0.0_wp, 2.0_wp, 0.5_wp], [3, 1]), 1.0_wp, omega)
    call series_at(g, 3.0_wp, x, slope)
    call expand_series(g, 3.0_wp, 5, taylor)
    call tally%near(x, 2*cos(0.5_wp), 4*eps, "constant")
    call tally%is_true(slope == 0 .and. all(taylor(1:) == 0), "a constant has no slope")
    call tally%is_true(fastest_rate(g) == 0 .and. bound_derivative(g, 1) == 0, "nor a rate")
    call series_at(steady_response(g, 0.1_wp), 3.0_wp, x, slope)
    call tally%is_true(x == 0 .and. slope == 0, "nothing drives the response")
  end subroutine test_constant
end program test_harmonic_series
