!> A flank's motion as a short harmonic series of time, and such series themselves: value, slope and
!> Taylor coefficients anywhere.
module lapwing_flank_series
  use lapwing_flank, only: flank_t, set_knots
  use lapwing_kinds, only: wp
  use lapwing_polynomial_evaluation, only: max_degree, bernstein_about
  implicit none
  private
  public :: series_flank_t, make_series_flank
  public :: harmonic_series_t, harmonic_series, steady_response, series_at, expand_series
  public :: derivative_series, bound_derivative, top_order, fastest_rate
  public :: turned_t, turn_series, turned_value, turned_taylor, turned_tail, versed, max_terms

  integer, parameter :: top_order = 15   !! highest Taylor coefficient
  integer, parameter :: max_terms = 8    !! terms that count as few

  !> x(t) = constant + sum_i cosine(i) cos(rate(i) t) + sine(i) sin(rate(i) t).
  type :: harmonic_series_t
    real(wp) :: constant = 0
    real(wp), allocatable :: rate(:)        !! per tau, positive
    logical, allocatable :: next(:)         !! whether a rate is the one before and the first one
    real(wp), allocatable :: cosine(:)      !! rad
    real(wp), allocatable :: sine(:)        !! rad
    real(wp), allocatable :: weight(:, :)   !! (0:top_order, terms) signed rate**k/k!
  end type harmonic_series_t

  !> g as one smooth piece.
  type, extends(flank_t) :: series_flank_t
    type(harmonic_series_t) :: series              !! g
  contains
    procedure :: taylor, motion, range, lower_bound
  end type series_flank_t

  !> Cosine and sine of each term at one time, for all series of the same rates.
  type :: turned_t
    real(wp) :: c(max_terms), s(max_terms)
  end type turned_t

contains

  !> A flank that moves as a series.
  pure subroutine make_series_flank(series, period, self, error)
    type(harmonic_series_t), intent(in) :: series   !! g
    real(wp), intent(in) :: period                  !! mesh period in tau
    type(series_flank_t), intent(out) :: self       !! the flank
    integer, intent(out) :: error                   !! 0, or there is no memory for it
    call set_knots(self, [0.0_wp, 1.0_wp], [.false.], period, error)
    self%series = series
    self%push = 2*bound_derivative(series, 2)
  end subroutine make_series_flank

  !> The first six Taylor coefficients about t.
  pure subroutine taylor(self, piece, t, local)
    class(series_flank_t), intent(in) :: self
    integer, intent(in) :: piece                    !! without effect
    real(wp), intent(in) :: t                       !! time
    real(wp), intent(out) :: local(0:max_degree)    !! coefficients
    call expand_series(self%series, t, max_degree, local)
  end subroutine taylor

  !> g and g' at t.
  pure subroutine motion(self, t, guess, g, slope)
    class(series_flank_t), intent(in) :: self
    real(wp), intent(in) :: t                       !! time
    integer, intent(in) :: guess                    !! without effect
    real(wp), intent(out) :: g, slope               !! position and velocity
    call series_at(self%series, t, g, slope)
  end subroutine motion

  !> Bounds of g: its Taylor polynomial's about the middle, and what that leaves out.
  pure subroutine range(self, piece, from, width, low, high)
    class(series_flank_t), intent(in) :: self
    integer, intent(in) :: piece                    !! without effect
    real(wp), intent(in) :: from, width             !! interval
    real(wp), intent(out) :: low, high              !! bounds
    real(wp) :: c(0:max_degree), half, rest
    half = 0.5_wp*width
    call expand_series(self%series, from + half, max_degree, c)
    c = bernstein_about(c, half)
    rest = bound_derivative(self%series, max_degree + 1)*half**(max_degree + 1)
    low = minval(c) - rest
    high = maxval(c) + rest
  end subroutine range

  !> Lower bound of g from the sizes of the terms.
  pure real(wp) function lower_bound(self)
    class(series_flank_t), intent(in) :: self
    lower_bound = self%series%constant - bound_derivative(self%series, 0)
  end function lower_bound

  !> Series from terms amplitude*cos(order*Omega*t + shift).
  pure function harmonic_series(terms, scale, mesh_frequency_ratio) result(self)
    real(wp), intent(in) :: terms(:, :)             !! (3, n): order, amplitude, shift
    real(wp), intent(in) :: scale                   !! factor of all amplitudes
    real(wp), intent(in) :: mesh_frequency_ratio    !! Omega
    type(harmonic_series_t) :: self
    logical :: moving(size(terms, 2))
    ! A term without amplitude must not meet a resonance.
    moving = terms(1, :) > 0 .and. terms(2, :) /= 0
    self%constant = scale*sum(terms(2, :)*cos(terms(3, :)), mask=.not. moving)
    self%rate = mesh_frequency_ratio*pack(terms(1, :), moving)
    self%next = follow_on(pack(terms(1, :), moving))
    self%cosine = scale*pack(terms(2, :)*cos(terms(3, :)), moving)
    self%sine = -scale*pack(terms(2, :)*sin(terms(3, :)), moving)
    call weigh(self)
  end function harmonic_series

  !> Of each order whether it is the one before and the first one, together.
  pure function follow_on(order) result(next)
    real(wp), intent(in) :: order(:)                !! whole numbers
    logical :: next(size(order))
    integer :: i
    next = .false.
    do i = 2, size(order)
      next(i) = nint(order(i)) == nint(order(i - 1)) + nint(order(1))
    end do
  end function follow_on

  !> Signed rate**k/k! of the derivatives' pattern value, rate, -value, -rate, ...
  pure subroutine weigh(self)
    type(harmonic_series_t), intent(inout) :: self   !! series, its terms known
    integer :: k
    allocate (self%weight(0:top_order, size(self%rate)))
    self%weight(0, :) = 1
    do k = 1, top_order
      self%weight(k, :) = self%weight(k - 1, :)*self%rate/k
      if (mod(k, 2) == 0) self%weight(k, :) = -self%weight(k, :)
    end do
  end subroutine weigh

  !> Periodic solution of q'' + 2 xi q' + q = -x''.
  !> With x = Re(X exp(i r t)): q = Re(r**2 X exp(i r t)/(1 - r**2 + 2 i xi r)).
  pure function steady_response(self, xi) result(response)
    type(harmonic_series_t), intent(in) :: self   !! x
    real(wp), intent(in) :: xi                    !! damping ratio
    type(harmonic_series_t) :: response
    real(wp), allocatable :: stiff(:), loss(:), size2(:)
    stiff = (1 - self%rate)*(1 + self%rate)
    loss = 2*xi*self%rate
    size2 = (stiff**2 + loss**2)/self%rate**2
    response%rate = self%rate
    response%next = self%next
    response%cosine = (stiff*self%cosine - loss*self%sine)/size2
    response%sine = (stiff*self%sine + loss*self%cosine)/size2
    call weigh(response)
  end function steady_response

  !> Series of a derivative.
  pure function derivative_series(self, order) result(derivative)
    type(harmonic_series_t), intent(in) :: self   !! series
    integer, intent(in) :: order                  !! even
    type(harmonic_series_t) :: derivative
    real(wp) :: sign
    sign = merge(1.0_wp, -1.0_wp, mod(order, 4) == 0)
    derivative%rate = self%rate
    derivative%next = self%next
    derivative%cosine = sign*self%cosine*self%rate**order
    derivative%sine = sign*self%sine*self%rate**order
    call weigh(derivative)
  end function derivative_series

  !> Cosines and sines of the terms at a time. By the sum of two angles they are as right as of the
  !> rounded product of a rate and the time, for a fifth of the cost.
  pure subroutine turn_series(self, t, turned)
    type(harmonic_series_t), intent(in) :: self   !! series
    real(wp), intent(in) :: t                     !! time
    type(turned_t), intent(out) :: turned         !! of each term
    integer :: i
    do i = 1, size(self%rate)
      if (self%next(i)) then
        turned%c(i) = turned%c(i - 1)*turned%c(1) - turned%s(i - 1)*turned%s(1)
        turned%s(i) = turned%s(i - 1)*turned%c(1) + turned%c(i - 1)*turned%s(1)
      else
        turned%c(i) = cos(self%rate(i)*t)
        turned%s(i) = sin(self%rate(i)*t)
      end if
    end do
  end subroutine turn_series

  !> 1 - cos x, sin x and x - sin x, each to rounding of its own size.
  pure subroutine versed(x, versine, sine, lag)
    real(wp), intent(in) :: x                           !! angle, not negative
    real(wp), intent(out) :: versine, sine, lag         !! the three
    !> Terms of a series up to 1/2 that leave less than rounding, whatever the kind.
    integer, parameter :: terms = precision(x)/2
    integer :: k
    if (x > 0.5_wp) then
      sine = sin(x)
      lag = x - sine
      versine = 2*sin(0.5_wp*x)**2
    else
      lag = 1
      versine = 1
      do k = terms, 1, -1
        lag = 1 - lag*(x**2*(1.0_wp/((2*k + 2)*(2*k + 3))))
        versine = 1 - versine*(x**2*(1.0_wp/((2*k + 1)*(2*k + 2))))
      end do
      lag = lag*x**3/6
      versine = versine*x**2/2
      sine = x - lag
    end if
  end subroutine versed

  !> Value and slope.
  pure subroutine turned_value(self, turned, x, slope)
    type(harmonic_series_t), intent(in) :: self   !! series
    type(turned_t), intent(in) :: turned          !! its terms
    real(wp), intent(out) :: x, slope             !! value, rate
    integer :: i
    x = self%constant
    slope = 0
    do i = 1, size(self%rate)
      x = x + (self%cosine(i)*turned%c(i) + self%sine(i)*turned%s(i))
      slope = slope + self%rate(i)*(self%sine(i)*turned%c(i) - self%cosine(i)*turned%s(i))
    end do
  end subroutine turned_value

  !> The first six Taylor coefficients.
  pure subroutine turned_taylor(self, turned, taylor)
    type(harmonic_series_t), intent(in) :: self   !! series
    type(turned_t), intent(in) :: turned          !! its terms
    real(wp), intent(out) :: taylor(0:5)          !! coefficients
    real(wp) :: even, odd
    integer :: i
    taylor(0) = self%constant
    taylor(1:5) = 0
    do i = 1, size(self%rate)
      even = self%cosine(i)*turned%c(i) + self%sine(i)*turned%s(i)
      odd = self%sine(i)*turned%c(i) - self%cosine(i)*turned%s(i)
      taylor(0) = taylor(0) + even
      taylor(1) = taylor(1) + self%weight(1, i)*odd
      taylor(2) = taylor(2) + self%weight(2, i)*even
      taylor(3) = taylor(3) + self%weight(3, i)*odd
      taylor(4) = taylor(4) + self%weight(4, i)*even
      taylor(5) = taylor(5) + self%weight(5, i)*odd
    end do
  end subroutine turned_taylor

  !> Taylor coefficients from the seventh on.
  pure subroutine turned_tail(self, turned, first, last, taylor)
    type(harmonic_series_t), intent(in) :: self   !! series
    type(turned_t), intent(in) :: turned          !! its terms
    integer, intent(in) :: first, last            !! orders, even and odd, at most top_order
    real(wp), intent(inout) :: taylor(0:last)     !! coefficients
    real(wp) :: even, odd
    integer :: i, k
    taylor(first:last) = 0
    do i = 1, size(self%rate)
      even = self%cosine(i)*turned%c(i) + self%sine(i)*turned%s(i)
      odd = self%sine(i)*turned%c(i) - self%cosine(i)*turned%s(i)
      do k = first, last, 2
        taylor(k) = taylor(k) + self%weight(k, i)*even
        taylor(k + 1) = taylor(k + 1) + self%weight(k + 1, i)*odd
      end do
    end do
  end subroutine turned_tail

  !> Value and slope.
  pure subroutine series_at(self, t, x, slope)
    type(harmonic_series_t), intent(in) :: self   !! series
    real(wp), intent(in) :: t                     !! time
    real(wp), intent(out) :: x, slope             !! value, rate
    type(turned_t) :: turned
    call turn_series(self, t, turned)
    call turned_value(self, turned, x, slope)
  end subroutine series_at

  !> Taylor coefficients about t.
  pure subroutine expand_series(self, t, n, taylor)
    type(harmonic_series_t), intent(in) :: self   !! series
    real(wp), intent(in) :: t                     !! time
    integer, intent(in) :: n                      !! highest coefficient, odd, 5 to top_order
    real(wp), intent(out) :: taylor(0:n)          !! coefficients
    type(turned_t) :: turned
    call turn_series(self, t, turned)
    call turned_taylor(self, turned, taylor)
    if (n > 5) call turned_tail(self, turned, 6, n, taylor)
  end subroutine expand_series

  !> Bound of |k-th derivative|/k!, at all times.
  pure real(wp) function bound_derivative(self, k)
    type(harmonic_series_t), intent(in) :: self   !! series
    integer, intent(in) :: k                      !! order
    bound_derivative = sum(abs(self%weight(k, :))*hypot(self%cosine, self%sine))
  end function bound_derivative

  !> Largest rate, 0 without terms.
  pure real(wp) function fastest_rate(self)
    type(harmonic_series_t), intent(in) :: self   !! series
    fastest_rate = max(0.0_wp, maxval(self%rate))
  end function fastest_rate
end module lapwing_flank_series
