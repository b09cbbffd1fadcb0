!> The free damped oscillator x'' + 2 xi x' + x = 0 in closed form, xi from 0 to overdamped.
!>
!> With w**2 = 1 - xi**2, and hyperbolic functions where that is negative,
!>     x(s)  = d x0 + e (x0' + xi x0),   d = exp(-xi s) cos(w s),  e = exp(-xi s) sin(w s)/w,
!>     x'(s) = d x0' - e (x0 + xi x0').
!> Near xi = 1, and over short times, e is taken from the series of sin(w s)/w.
module lapwing_system_oscillation
  use lapwing_kinds, only: wp
  implicit none
  private
  public :: damped_t, damped, free_motion, free_matrix, near_matrix, turn_undamped
  public :: taylor_row, n_taylor, free_state, free_after, lasting_t, lasting

  integer, parameter :: n_taylor = 15   !! derivatives tabulated by `taylor_row`

  !> One damping ratio.
  type :: damped_t
    real(wp) :: xi = 0                     !! damping ratio, not negative
    real(wp) :: square = 1                 !! 1 - xi**2
    real(wp) :: w = 1                      !! root of its magnitude
    logical :: apart = .false.             !! overdamped, by so much that its two rates are apart
    real(wp) :: fast_rate = 1              !! of overdamped decay; else both are those of the
    real(wp) :: slow_rate = 1              !! oscillation, 1
    real(wp) :: row(2, 0:n_taylor) = 0     !! x^(k)/k! = row(1,k) x + row(2,k) x'
    real(wp) :: unit(0:n_taylor, 2) = 0    !! its columns: x of unit x, of unit x'
  end type damped_t

  !> What is left of a free oscillation: bounds that hold from a time on.
  type :: lasting_t
    real(wp) :: x = 0, v = 0               !! of |x| and |x'|
    real(wp) :: sixth = 0                  !! of |x^(6)|/6!
  end type lasting_t

  !> From here on the two rates of decay differ by a third or more.
  real(wp), parameter :: least_apart = 1.05_wp

contains

  pure function damped(xi) result(self)
    real(wp), intent(in) :: xi       !! damping ratio, not negative
    type(damped_t) :: self
    self%xi = xi
    self%square = (1 - xi)*(1 + xi)
    self%w = sqrt(abs(self%square))
    self%apart = xi >= least_apart
    if (xi > 1) then
      self%fast_rate = xi + self%w
      self%slow_rate = 1/self%fast_rate
    end if
    self%row = taylor_row(xi)
    self%unit = transpose(self%row)
  end function damped

  !> Taylor coefficients of x as combinations of x and x': x^(k+2) = -2 xi x^(k+1) - x^(k).
  pure function taylor_row(xi) result(row)
    real(wp), intent(in) :: xi       !! damping ratio
    real(wp) :: row(2, 0:n_taylor)
    integer :: k
    row(:, 0) = [1, 0]
    row(:, 1) = [0, 1]
    do k = 2, n_taylor
      row(:, k) = -(2*xi*(k - 1)*row(:, k - 1) + row(:, k - 2))/(k*(k - 1))
    end do
  end function taylor_row

  !> d(s) and e(s) of the module's head.
  pure subroutine free_motion(self, s, d, e)
    type(damped_t), intent(in) :: self   !! damping
    real(wp), intent(in) :: s            !! time, not negative
    real(wp), intent(out) :: d, e        !! the two solutions
    real(wp) :: angle, decay, slow
    angle = self%w*s
    if (angle < 0.5_wp) then
      decay = exp(-self%xi*s)
      call series(sign(angle**2, self%square), d, e)
      d = decay*d
      e = decay*e*s
    else if (self%square > 0) then
      decay = exp(-self%xi*s)
      d = decay*cos(angle)
      e = decay*sin(angle)/self%w
    else
      ! xi - w without cancellation; the fast part is gone where its exponential underflows.
      slow = 0.5_wp*exp(-s/(self%xi + self%w))
      decay = 0.5_wp*exp(-(self%xi + self%w)*s)
      d = slow + decay
      e = (slow - decay)/self%w
    end if
  end subroutine free_motion

  !> cos(sqrt(x)) and sin(sqrt(x))/sqrt(x) for |x| <= 1/4, by as many terms as the kind needs.
  pure subroutine series(x, c, s)
    real(wp), intent(in) :: x        !! square of the angle, negative: hyperbolic
    real(wp), intent(out) :: c, s    !! the two functions
    real(wp) :: term
    integer :: k
    c = 1
    s = 1
    term = 1
    do k = 1, 40
      term = -term*x/(2*k*(2*k - 1))
      c = c + term
      s = s + term/(2*k + 1)
      if (abs(term) < epsilon(x)*0.25_wp) exit
    end do
  end subroutine series

  !> Where the two rates are apart: x = slow + fast, x' = -slow_rate*slow - fast_rate*fast, which
  !> keeps the digits of x' after the fast part has gone.
  pure subroutine free_modes(self, begin, s, slow, fast)
    type(damped_t), intent(in) :: self   !! damping
    real(wp), intent(in) :: begin(2)     !! x, x' at s = 0
    real(wp), intent(in) :: s            !! time, not negative
    real(wp), intent(out) :: slow, fast  !! the two parts
    slow = (begin(2) + self%fast_rate*begin(1))/(2*self%w)*exp(-self%slow_rate*s)
    fast = -(begin(2) + self%slow_rate*begin(1))/(2*self%w)*exp(-self%fast_rate*s)
  end subroutine free_modes

  !> (x, x') after a time whose two solutions are known.
  pure function free_state(self, begin, d, e) result(state)
    type(damped_t), intent(in) :: self   !! damping
    real(wp), intent(in) :: begin(2)     !! at its beginning
    real(wp), intent(in) :: d, e         !! see `free_motion`
    real(wp) :: state(2)
    if (.not. self%xi > 0) then
      state = turn_undamped(d, e, begin)
      return
    end if
    state(1) = d*begin(1) + e*(begin(2) + self%xi*begin(1))
    state(2) = d*begin(2) - e*(begin(1) + self%xi*begin(2))
  end function free_state

  !> The same after a time. Where the rates are apart, and as many digits are asked for long after
  !> the fast part has gone, by the two parts.
  pure function free_after(self, begin, s, long_after) result(state)
    type(damped_t), intent(in) :: self   !! damping
    real(wp), intent(in) :: begin(2)     !! x, x' at s = 0
    real(wp), intent(in) :: s            !! time, not negative
    logical, intent(in) :: long_after    !! whether it may be that long
    real(wp) :: state(2), d, e
    if (long_after .and. self%apart) then
      call free_modes(self, begin, s, d, e)
      state = [d + e, -(self%slow_rate*d + self%fast_rate*e)]
    else
      call free_motion(self, s, d, e)
      state = free_state(self, begin, d, e)
    end if
  end function free_after

  !> Bounds of a free oscillation from a time on: of (x, x') then, which never grows, or of its two
  !> parts.
  pure function lasting(self, begin, s) result(left)
    type(damped_t), intent(in) :: self   !! damping
    real(wp), intent(in) :: begin(2)     !! x, x' at s = 0
    real(wp), intent(in) :: s            !! time, not negative
    type(lasting_t) :: left
    real(wp) :: d, e, size, slow, fast
    if (self%apart) then
      call free_modes(self, begin, s, slow, fast)
      left%x = abs(slow) + abs(fast)
      left%v = self%slow_rate*abs(slow) + self%fast_rate*abs(fast)
      left%sixth = (self%slow_rate**6*abs(slow) + self%fast_rate**6*abs(fast))/720
    else
      call free_motion(self, s, d, e)
      size = hypot(d*begin(1) + e*(begin(2) + self%xi*begin(1)), &
          d*begin(2) - e*(begin(1) + self%xi*begin(2)))
      left = lasting_t(size, size, norm2(self%row(:, 6))*size)
    end if
  end function lasting

  !> Matrix that moves (x, x') over a time s.
  pure function free_matrix(self, s) result(matrix)
    type(damped_t), intent(in) :: self   !! damping
    real(wp), intent(in) :: s            !! time, not negative
    real(wp) :: matrix(2, 2)
    real(wp) :: d, e
    call free_motion(self, s, d, e)
    matrix(1, 1) = d + self%xi*e
    matrix(1, 2) = e
    matrix(2, 1) = -e
    matrix(2, 2) = d - self%xi*e
  end function free_matrix

  !> The same over a short time of either sign, by the Taylor series: exact to rounding over half a
  !> panel. With x of unit x and unit x' being c and s, c' = -s and s' = c - 2 xi s.
  pure function near_matrix(self, s) result(matrix)
    type(damped_t), intent(in) :: self   !! damping
    real(wp), intent(in) :: s            !! time
    real(wp) :: matrix(2, 2), even(2), odd(2), square
    integer :: k
    square = s*s
    even = self%row(:, n_taylor - 1)
    odd = self%row(:, n_taylor)
    do k = n_taylor - 3, 0, -2
      even = even*square + self%row(:, k)
      odd = odd*square + self%row(:, k + 1)
    end do
    matrix(1, :) = even + s*odd
    matrix(2, 1) = -matrix(1, 2)
    matrix(2, 2) = matrix(1, 1) - 2*self%xi*matrix(1, 2)
  end function near_matrix

  !> (x, x') without damping, turned through the angle whose cosine and sine are given, and rounded
  !> once. Cycles that are all the same turn it through one angle again and again: the rounding of
  !> cosine, sine and products would change its size by the same part each time.
  pure function turn_undamped(c, s, x) result(turned)
    real(wp), intent(in) :: c, s     !! cosine and sine, rounded
    real(wp), intent(in) :: x(2)     !! before
    real(wp) :: turned(2), lack
    lack = 0.5_wp*lack_of_unity(c, s)
    turned(1) = precise_sum(c, x(1), s, x(2), lack)
    turned(2) = precise_sum(c, x(2), -s, x(1), lack)
  end function turn_undamped

  !> 1 - c**2 - s**2, not just its rounding.
  pure real(wp) function lack_of_unity(c, s)
    real(wp), intent(in) :: c, s     !! cosine and sine, rounded
    ! One less the larger square is exact.
    lack_of_unity = ((1 - max(c*c, s*s)) - min(c*c, s*s)) - (product_rest(c, c) &
        + product_rest(s, s))
  end function lack_of_unity

  !> (a*b + c*d)*(1 + lack), rounded once.
  pure real(wp) function precise_sum(a, b, c, d, lack)
    real(wp), intent(in) :: a, b, c, d     !! factors
    real(wp), intent(in) :: lack           !! small
    real(wp) :: p, q, total, part, rest
    p = a*b
    q = c*d
    total = p + q
    part = total - p
    rest = (p - (total - part)) + (q - part)
    precise_sum = total + (rest + product_rest(a, b) + product_rest(c, d) + lack*total)
  end function precise_sum

  !> a*b less its rounded value (Dekker, Numer. Math. 18 (1971) 224-242).
  pure real(wp) function product_rest(a, b)
    real(wp), intent(in) :: a, b           !! factors
    real(wp), parameter :: half_word = 2.0_wp**((digits(1.0_wp) + 1)/2) + 1
    real(wp) :: x(2), high(2), low(2)
    x = [a, b]
    high = half_word*x
    high = high - (high - x)
    low = x - high
    product_rest = ((high(1)*high(2) - a*b) + high(1)*low(2) + low(1)*high(2)) + low(1)*low(2)
  end function product_rest
end module lapwing_system_oscillation
