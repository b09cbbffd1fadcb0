!> The free damped oscillator x'' + 2 xi x' + x = 0 in closed form, xi from 0 to overdamped.
!>
!> With w**2 = 1 - xi**2, and hyperbolic functions where that is negative,
!>     x(s)  = d x0 + e (x0' + xi x0),   d = exp(-xi s) cos(w s),  e = exp(-xi s) sin(w s)/w,
!>     x'(s) = d x0' - e (x0 + xi x0').
!> Near xi = 1, and over short times, e is taken from the series of sin(w s)/w.
module lapwing_damped
  use lapwing_kinds, only: wp
  implicit none
  private
  public :: damped_t, damped, free_motion, free_matrix, taylor_row, n_taylor

  integer, parameter :: n_taylor = 13   !! derivatives tabulated by `taylor_row`

  !> One damping ratio.
  type :: damped_t
    real(wp) :: xi = 0                     !! damping ratio, not negative
    real(wp) :: square = 1                 !! 1 - xi**2
    real(wp) :: w = 1                      !! root of its magnitude
    real(wp) :: row(2, 0:n_taylor) = 0     !! x^(k)/k! = row(1,k) x + row(2,k) x'
  end type damped_t

contains

  pure function damped(xi) result(self)
    real(wp), intent(in) :: xi       !! damping ratio, not negative
    type(damped_t) :: self
    self%xi = xi
    self%square = (1 - xi)*(1 + xi)
    self%w = sqrt(abs(self%square))
    self%row = taylor_row(xi)
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
end module lapwing_damped
