!> Polynomials of low degree on a short interval: values, shifts, and bounds.
!>
!> A polynomial is its coefficients c(0:d), lowest power first.
module lapwing_polynomial_evaluation
  use lapwing_kinds, only: wp
  implicit none
  private
  public :: max_degree, horner, horner_slope, value_and_slope, jet, taylor_shift, shift_quintic, &
      bend_beyond
  public :: bernstein, bernstein_on, bernstein_about, scale_to_unit, upper_bound, never_below, &
      least, largest

  integer, parameter :: max_degree = 5

contains

  !> Value at x.
  pure real(wp) function horner(c, x)
    real(wp), intent(in) :: c(0:)  !! coefficients
    real(wp), intent(in) :: x      !! argument
    integer :: i
    horner = c(ubound(c, 1))
    do i = ubound(c, 1) - 1, 0, -1
      horner = horner*x + c(i)
    end do
  end function horner

  !> First derivative at x.
  pure real(wp) function horner_slope(c, x)
    real(wp), intent(in) :: c(0:)  !! coefficients
    real(wp), intent(in) :: x      !! argument
    integer :: i
    horner_slope = ubound(c, 1)*c(ubound(c, 1))
    do i = ubound(c, 1) - 1, 1, -1
      horner_slope = horner_slope*x + i*c(i)
    end do
  end function horner_slope

  !> Both at once, of a polynomial of the highest degree.
  pure subroutine value_and_slope(c, x, value, slope)
    real(wp), intent(in) :: c(0:max_degree)  !! coefficients
    real(wp), intent(in) :: x                !! argument
    real(wp), intent(out) :: value, slope    !! there
    integer :: i
    value = c(max_degree)
    slope = 0
    do i = max_degree - 1, 0, -1
      slope = slope*x + value
      value = value*x + c(i)
    end do
  end subroutine value_and_slope

  !> Value, first derivative and half the second one at x, of odd degree. Even and odd powers side
  !> by side: chains of additions of half the length.
  pure subroutine jet(n, c, x, value, slope, bend)
    integer, intent(in) :: n                    !! degree, odd
    real(wp), intent(in) :: c(0:n)              !! coefficients
    real(wp), intent(in) :: x                   !! argument
    real(wp), intent(out) :: value, slope, bend !! there
    real(wp) :: square, a(2), b(2), d(2)
    integer :: k
    ! Values, derivatives with respect to the square, and half the second ones.
    square = x*x
    a = c(n - 1:n)
    b = 0
    d = 0
    do k = n - 3, 0, -2
      d = d*square + b
      b = b*square + a
      a = a*square + c(k:k + 1)
    end do
    value = a(1) + x*a(2)
    slope = a(2) + 2*x*(b(1) + x*b(2))
    bend = (b(1) + 3*x*b(2)) + 4*square*(d(1) + x*d(2))
  end subroutine jet

  !> How far the second derivative is from 2 c(2) within a reach of the origin, at most.
  pure real(wp) function bend_beyond(c, reach) result(bound)
    real(wp), intent(in) :: c(0:)  !! coefficients
    real(wp), intent(in) :: reach  !! largest |x|
    real(wp) :: power
    integer :: k
    bound = 0
    power = reach
    do k = 3, ubound(c, 1)
      bound = bound + (k*(k - 1))*abs(c(k))*power
      power = power*reach
    end do
  end function bend_beyond

  !> Coefficients about x instead of 0 (repeated synthetic division).
  pure subroutine taylor_shift(c, x)
    real(wp), intent(inout) :: c(0:)  !! coefficients, re-expanded in place
    real(wp), intent(in) :: x         !! new origin
    integer :: i, k
    do i = 0, ubound(c, 1) - 1
      do k = ubound(c, 1) - 1, i, -1
        c(k) = c(k) + x*c(k + 1)
      end do
    end do
  end subroutine taylor_shift

  !> The same of six coefficients, to the same bits, written out: in registers it takes a third of
  !> the time, and a step begins with it.
  pure subroutine shift_quintic(c, x, about)
    real(wp), intent(in) :: c(0:5)           !! coefficients about 0
    real(wp), intent(in) :: x                !! new origin
    real(wp), intent(out) :: about(0:5)      !! coefficients about x
    real(wp) :: c0, c1, c2, c3, c4
    c4 = c(4) + x*c(5)
    c3 = c(3) + x*c4
    c2 = c(2) + x*c3
    c1 = c(1) + x*c2
    c0 = c(0) + x*c1
    c4 = c4 + x*c(5)
    c3 = c3 + x*c4
    c2 = c2 + x*c3
    c1 = c1 + x*c2
    c4 = c4 + x*c(5)
    c3 = c3 + x*c4
    c2 = c2 + x*c3
    c4 = c4 + x*c(5)
    c3 = c3 + x*c4
    about(0) = c0
    about(1) = c1
    about(2) = c2
    about(3) = c3
    about(4) = c4 + x*c(5)
    about(5) = c(5)
  end subroutine shift_quintic

  !> Bernstein coefficients on [0, 1]: b_j = sum_i C(j,i)/C(d,i) c_i.
  pure function bernstein(c) result(b)
    real(wp), intent(in) :: c(0:max_degree)  !! coefficients
    real(wp) :: b(0:max_degree)
    real(wp), parameter :: inverse_binomial(0:max_degree) = &
        [1.0_wp, 0.2_wp, 0.1_wp, 0.1_wp, 0.2_wp, 1.0_wp]
    integer :: i, k
    b = c*inverse_binomial
    do i = 1, max_degree
      do k = max_degree, i, -1
        b(k) = b(k) + b(k - 1)
      end do
    end do
  end function bernstein

  !> Bernstein coefficients on [0, length].
  pure function bernstein_on(c, length) result(b)
    real(wp), intent(in) :: c(0:max_degree)  !! coefficients
    real(wp), intent(in) :: length           !! interval
    real(wp) :: b(0:max_degree), scaled(0:max_degree)
    call scale_to_unit(c, length, scaled)
    b = bernstein(scaled)
  end function bernstein_on

  !> Bernstein coefficients on [-half, half] of the first terms of a series about the middle.
  pure function bernstein_about(taylor, half) result(b)
    real(wp), intent(in) :: taylor(0:)       !! coefficients
    real(wp), intent(in) :: half             !! half the interval
    real(wp) :: b(0:max_degree), c(0:max_degree)
    c = taylor(0:max_degree)
    call taylor_shift(c, -half)
    b = bernstein_on(c, 2*half)
  end function bernstein_about

  !> Least coefficient. (Where one is not a number `minval` looks for it, at some cost.)
  pure real(wp) function least(b)
    real(wp), intent(in) :: b(0:max_degree)  !! coefficients
    least = min(min(b(0), b(1)), min(b(2), b(3)), min(b(4), b(5)))
  end function least

  !> Largest coefficient.
  pure real(wp) function largest(b)
    real(wp), intent(in) :: b(0:max_degree)  !! coefficients
    largest = max(max(b(0), b(1)), max(b(2), b(3)), max(b(4), b(5)))
  end function largest

  !> Upper bound on [0, length]: the largest Bernstein coefficient.
  pure real(wp) function upper_bound(c, length)
    real(wp), intent(in) :: c(0:max_degree)  !! coefficients
    real(wp), intent(in) :: length           !! interval
    integer :: k
    upper_bound = maxval(bernstein(c*[(length**k, k = 0, max_degree)]))
  end function upper_bound

  !> Lower bound on [0, 1] for the price of a value, good where the first terms decide:
  !> c0 + x*q(x) is not below c0 + min(0, min q).
  pure real(wp) function never_below(c)
    real(wp), intent(in) :: c(0:max_degree)  !! coefficients
    integer :: k
    never_below = c(max_degree)
    do k = max_degree - 1, 0, -1
      never_below = c(k) + min(0.0_wp, never_below)
    end do
  end function never_below

  pure subroutine scale_to_unit(c, length, scaled)
    real(wp), intent(in) :: c(0:max_degree)        !! coefficients
    real(wp), intent(in) :: length                 !! interval that becomes [0, 1]
    real(wp), intent(out) :: scaled(0:max_degree)  !! coefficients on it
    real(wp) :: power
    integer :: i
    power = 1
    do i = 0, max_degree
      scaled(i) = c(i)*power
      power = power*length
    end do
  end subroutine scale_to_unit
end module lapwing_polynomial_evaluation
