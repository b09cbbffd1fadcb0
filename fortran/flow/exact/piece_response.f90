!> Responses of contact to a flank that moves as a polynomial: solutions q of
!>     q'' + 2 xi q' + q = h,    h = -g'',
!> as Taylor series. Which of them is taken is free, for the rest is a free oscillation.
module lapwing_flow_exact_piece_response
  use lapwing_kinds, only: wp
  use lapwing_system_oscillation, only: damped_t, n_taylor
  use lapwing_polynomial_evaluation, only: max_degree, taylor_shift
  use lapwing_flank_table, only: te_table_t
  implicit none
  private
  public :: forced_taylor, fixed_point, sixth_of, has_slow_response, slow_response

  integer, parameter :: bound_order = max_degree + 1   !! first derivative that bounds leave out
  integer, parameter :: top = max_degree - 2           !! degree of h

contains

  !> Taylor series about x after a piece's beginning of the response that is at rest there.
  pure function forced_taylor(xi, table, piece, x) result(c)
    real(wp), intent(in) :: xi                 !! damping ratio
    type(te_table_t), intent(in) :: table      !! g as a table
    integer, intent(in) :: piece
    real(wp), intent(in) :: x                  !! origin
    real(wp) :: c(0:n_taylor), g(0:max_degree)
    integer :: k
    g = table%coefficient(:, piece)
    call taylor_shift(g, x)
    c = 0
    do k = 2, n_taylor
      c(k) = -(2*xi*(k - 1)*c(k - 1) + c(k - 2))/real(k*(k - 1), wp)
      if (k <= max_degree) c(k) = c(k) - g(k)
    end do
  end function forced_taylor

  !> The state that comes back after a period: (1 - matrix) x = state. Where nothing drives it, 0.
  pure function fixed_point(matrix, state) result(x)
    real(wp), intent(in) :: matrix(2, 2)       !! free motion over the period
    real(wp), intent(in) :: state(2)           !! where zero comes to
    real(wp) :: x(2), m(2, 2), determinant
    x = 0
    if (all(state == 0)) return
    m = -matrix
    m(1, 1) = m(1, 1) + 1
    m(2, 2) = m(2, 2) + 1
    determinant = m(1, 1)*m(2, 2) - m(1, 2)*m(2, 1)
    x(1) = (m(2, 2)*state(1) - m(1, 2)*state(2))/determinant
    x(2) = (m(1, 1)*state(2) - m(2, 1)*state(1))/determinant
  end function fixed_point

  !> Bound of the sixth derivative over 6! of a polynomial on [-half, half].
  pure real(wp) function sixth_of(c, half)
    real(wp), intent(in) :: c(0:n_taylor)      !! coefficients
    real(wp), intent(in) :: half               !! half the interval
    real(wp) :: choose
    integer :: k
    sixth_of = 0
    choose = 1
    do k = bound_order, n_taylor
      sixth_of = sixth_of + choose*abs(c(k))*half**(k - bound_order)
      choose = choose*(k + 1)/real(k + 1 - bound_order, wp)
    end do
  end function sixth_of

  !> Whether a piece has a response that is as slow as the flank: it must last long against the
  !> time constant of what the response leaves out, or its terms cancel.
  pure logical function has_slow_response(damping, width, span) result(has)
    type(damped_t), intent(in) :: damping
    real(wp), intent(in) :: width              !! of the piece
    real(wp), intent(in) :: span               !! time constants that count as long
    has = width*max(1.0_wp, 2*damping%xi) > span
    if (has .and. .not. damping%apart) has = width*damping%slow_rate >= span
  end function has_slow_response

  !> That response, about x after the piece's beginning, its middle.
  !>
  !> A piece that is long against both rates of the spring has a response of degree three, h less
  !> its rates of change. One that is long against the fast rate r of an overdamped spring alone
  !> splits: with the slow rate 1/r,
  !>     q = (y - f)/(r - 1/r),    y' + y/r = h,    f' + r f = h,
  !> f of degree three, and y zero in the middle by its Taylor series.
  pure function slow_response(damping, table, piece, x, half, span) result(q)
    type(damped_t), intent(in) :: damping
    type(te_table_t), intent(in) :: table      !! g as a table
    integer, intent(in) :: piece
    real(wp), intent(in) :: x                  !! its middle, from its beginning
    real(wp), intent(in) :: half               !! half its width
    real(wp), intent(in) :: span               !! time constants that count as long
    real(wp) :: q(0:n_taylor), g(0:max_degree), h(0:top + 2), f(0:top + 1)
    integer :: k
    g = table%coefficient(:, piece)
    call taylor_shift(g, x)
    h = 0
    do k = 0, top
      h(k) = -(k + 1)*(k + 2)*g(k + 2)
    end do
    q = 0
    if (2*half*damping%slow_rate >= span) then
      do k = top, 0, -1
        q(k) = h(k) - 2*damping%xi*(k + 1)*q(k + 1) - (k + 2)*(k + 1)*q(k + 2)
      end do
      return
    end if
    f = 0
    do k = top, 0, -1
      f(k) = (h(k) - (k + 1)*f(k + 1))/damping%fast_rate
    end do
    do k = 1, n_taylor
      q(k) = -damping%slow_rate*q(k - 1)/k
      if (k <= top + 1) q(k) = q(k) + h(k - 1)/k
    end do
    q(0:top) = q(0:top) - f(0:top)
    q = q/(damping%fast_rate - damping%slow_rate)
  end function slow_response
end module lapwing_flow_exact_piece_response
