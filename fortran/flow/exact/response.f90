!> The steady response q of contact to the motion of a flank, and its bounds, on a scene's panels.
!> On a piece of a table it is one of the solutions of
!>     q'' + 2 xi q' + q = h,    h = -g'',
!> as a Taylor series. Which of them is taken is free, for the rest is a free oscillation.
module lapwing_flow_exact_response
  use lapwing_kinds, only: wp
  use lapwing_flank, only: flank_t
  use lapwing_flank_series, only: series_flank_t, harmonic_series_t, steady_response, &
      expand_series, series_at, bound_derivative, fastest_rate
  use lapwing_flank_table, only: te_table_t
  use lapwing_flow_exact_panels, only: closed_form_t, cut_evenly, cut_pieces, copy_panels, &
      bound_free_part, ordinary_panels, has_slow_response, panel_span, bound_order
  use lapwing_polynomial_evaluation, only: max_degree, horner, horner_slope, bernstein_about, &
      taylor_shift, &
      bend_beyond
  use lapwing_system_oscillation, only: damped, damped_t, free_matrix, n_taylor
  implicit none
  private
  public :: make_closed_form, make_form_at_rest

  integer, parameter :: top = max_degree - 2           !! degree of h = -g'' on a piece

contains

  !> Everything for one flank and one damping ratio.
  pure subroutine make_closed_form(flank, xi, period, most, self, error)
    class(flank_t), intent(in) :: flank             !! motion g: a table or a series
    real(wp), intent(in) :: xi                      !! damping ratio
    real(wp), intent(in) :: period                  !! mesh period
    integer, intent(in) :: most                     !! panels, before the scene is graded
    type(closed_form_t), intent(out) :: self        !! the closed form
    integer, intent(out) :: error                   !! 0, or there is no memory for it
    integer :: i
    self%period = period
    self%damping = damped(xi)
    self%free_bound = norm2(self%damping%row(:, bound_order))
    self%fastest = max(1.0_wp, 2*xi)
    error = 0
    select type (flank)
    type is (series_flank_t)
      call respond_to_series(self, flank%series, most, error)
    type is (te_table_t)
      call respond_to_table(self, flank, most, error)
    end select
    if (error /= 0) return
    if (.not. self%graded) call bound_free_part(self)
    self%q_low = huge(1.0_wp)
    self%q_high = -huge(1.0_wp)
    do i = 1, self%n
      self%q_low = min(self%q_low, minval(self%panel(i)%q_bernstein) - self%panel(i)%q_rest)
      self%q_high = max(self%q_high, maxval(self%panel(i)%q_bernstein) + self%panel(i)%q_rest)
    end do
  end subroutine make_closed_form

  pure subroutine respond_to_series(self, series, most, error)
    type(closed_form_t), intent(inout) :: self      !! rates are known
    type(harmonic_series_t), intent(in) :: series   !! g
    integer, intent(in) :: most                     !! panels, before the scene is graded
    integer, intent(out) :: error                   !! 0, or there is no memory for it
    self%q = steady_response(series, self%damping%xi)
    ! Without terms the series reaches as far as numbers do.
    self%fastest_in_flight = max(fastest_rate(series), tiny(1.0_wp))
    self%fastest = max(self%fastest, self%fastest_in_flight)
    self%g_bound = bound_derivative(series, bound_order)
    self%q_bound = bound_derivative(self%q, bound_order)
    self%graded = ordinary_panels(self%period, self%fastest) > most
    call cut_evenly(self, error)
    if (error == 0) call sample_series(self, series)
  end subroutine respond_to_series

  pure subroutine respond_to_table(self, table, most, error)
    type(closed_form_t), intent(inout) :: self      !! rates are known
    type(te_table_t), intent(in) :: table           !! g
    integer, intent(in) :: most                     !! panels, before the scene is graded
    integer, intent(out) :: error                   !! 0, or there is no memory for it
    self%graded = ordinary_panels(self%period, self%fastest) > most
    call cut_pieces(self, table, error)
    if (error /= 0) return
    if (self%graded) then
      call solve_pieces(self, table)
    else
      call solve_table(self, table)
    end if
    call bound_table_response(self)
  end subroutine respond_to_table

  !> The same panels on a flank that does not move: the spring's free oscillation is all there is.
  pure subroutine make_form_at_rest(moving, self, error)
    type(closed_form_t), intent(in) :: moving       !! of the other flank
    type(closed_form_t), intent(out) :: self        !! the closed form
    integer, intent(out) :: error                   !! 0, or there is no memory for it
    self%graded = moving%graded
    self%damping = moving%damping
    self%free_bound = moving%free_bound
    self%fastest = moving%fastest
    self%fastest_in_flight = moving%fastest_in_flight
    self%period = moving%period
    call copy_panels(moving, self, error)
    if (error /= 0) return
    if (.not. self%graded) call bound_free_part(self)
  end subroutine make_form_at_rest

  !> q and g of a series on the panels.
  pure subroutine sample_series(self, g)
    type(closed_form_t), intent(inout) :: self   !! q and g on the panels are set
    type(harmonic_series_t), intent(in) :: g
    integer :: i
    do i = 1, self%n
      associate (panel => self%panel(i))
        call expand_series(g, panel%middle, n_taylor, panel%g)
        call expand_series(self%q, panel%middle, n_taylor, panel%q)
        panel%g_bernstein = bernstein_about(panel%g, panel%half)
        panel%q_bernstein = bernstein_about(panel%q, panel%half)
        panel%g_rest = self%g_bound*panel%half**bound_order
        panel%q_rest = self%q_bound*panel%half**bound_order
        panel%g_bend = bend_beyond(panel%g, panel%half)
        panel%g_low = minval(panel%g_bernstein) - panel%g_rest
        panel%g_high = maxval(panel%g_bernstein) + panel%g_rest
        call series_at(self%q, self%edge(i), panel%q_begin(1), panel%q_begin(2))
        call series_at(self%q, self%edge(i + 1), panel%q_end(1), panel%q_end(2))
        panel%q_sixth = self%q_bound
      end associate
    end do
    do i = 1, self%n + 1
      call expand_series(g, self%edge(i), max_degree, self%g_taylor(:, i))
    end do
    self%g_low = minval(self%panel%g_low)
    self%g_high = maxval(self%panel%g_high)
  end subroutine sample_series

  !> q of a table: the response that is at rest in a panel's middle and a free part, joined over the
  !> knots and closed over the period.
  pure subroutine solve_table(self, table)
    type(closed_form_t), intent(inout) :: self      !! q on the panels is set
    type(te_table_t), intent(in) :: table           !! g as a table
    real(wp) :: matrix(2, 2), state(2), middle(2), finish(2)
    integer :: i
    do i = 1, self%n
      self%panel(i)%q = forced_taylor(self%damping%xi, table, self%piece(i), &
          self%panel(i)%middle - table%knot(self%piece(i)))
    end do
    state = 0
    matrix = reshape([1.0_wp, 0.0_wp, 0.0_wp, 1.0_wp], [2, 2])
    do i = 1, self%n
      call over_panel(self, i, state, middle, finish)
      matrix = matmul(free_matrix(self%damping, self%edge(i + 1) - self%edge(i)), matrix)
      state = finish
      if (i < self%n) state(2) = state(2) - jump_after(self, table, i)
    end do
    ! The jump at phase 0 belongs to the period's end.
    state(2) = state(2) - table%slope_jump(1)
    state = fixed_point(matrix, state)
    do i = 1, self%n
      call over_panel(self, i, state, middle, finish)
      associate (panel => self%panel(i))
        panel%q_begin = state
        panel%q_end = finish
        panel%q = panel%q + matmul(self%damping%unit, middle)
      end associate
      state = finish
      if (i < self%n) state(2) = state(2) - jump_after(self, table, i)
    end do
  end subroutine solve_table

  !> q of each piece of a table by itself, in a graded scene. On the few panels of a short piece it
  !> begins at rest.
  pure subroutine solve_pieces(self, table)
    type(closed_form_t), intent(inout) :: self      !! q on the panels is set
    type(te_table_t), intent(in) :: table           !! g as a table
    real(wp) :: state(2), middle(2), x
    integer :: i
    state = 0
    do i = 1, self%n
      associate (panel => self%panel(i))
        x = panel%middle - table%knot(self%piece(i))
        if (i > 1) then
          if (self%piece(i) /= self%piece(i - 1)) state = 0
        end if
        if (has_slow_response(self%damping, table%knot(self%piece(i) + 1) &
            - table%knot(self%piece(i)), panel_span)) then
          panel%q = slow_response(self%damping, table, self%piece(i), x, panel%half, panel_span)
          panel%q_begin = [horner(panel%q, -panel%half), horner_slope(panel%q, -panel%half)]
          panel%q_end = [horner(panel%q, panel%half), horner_slope(panel%q, panel%half)]
        else
          panel%q = forced_taylor(self%damping%xi, table, self%piece(i), x)
          panel%q_begin = state
          call over_panel(self, i, panel%q_begin, middle, state)
          panel%q_end = state
          panel%q = panel%q + matmul(self%damping%unit, middle)
        end if
      end associate
    end do
  end subroutine solve_pieces

  !> Response (x, x') at the end of a panel from that at its beginning, and its free part in the
  !> middle.
  pure subroutine over_panel(self, i, begin, middle, finish)
    type(closed_form_t), intent(in) :: self    !! scene, `q` without free parts
    integer, intent(in) :: i                   !! panel
    real(wp), intent(in) :: begin(2)           !! x, x'
    real(wp), intent(out) :: middle(2)         !! free part in the middle
    real(wp), intent(out) :: finish(2)         !! x, x'
    real(wp) :: matrix(2, 2)
    associate (q => self%panel(i)%q, half => self%panel(i)%half)
      matrix = free_matrix(self%damping, half)
      middle = matmul(matrix, begin - [horner(q, -half), horner_slope(q, -half)])
      finish = matmul(matrix, middle) + [horner(q, half), horner_slope(q, half)]
    end associate
  end subroutine over_panel

  !> Jump of g' where a panel ends within the period.
  pure real(wp) function jump_after(self, table, i)
    type(closed_form_t), intent(in) :: self    !! scene
    type(te_table_t), intent(in) :: table      !! g as a table
    integer, intent(in) :: i                   !! panel
    jump_after = 0
    if (self%piece(i + 1) /= self%piece(i)) jump_after = table%slope_jump(self%piece(i + 1))
  end function jump_after

  !> Bernstein coefficients of q on the panels of a table.
  pure subroutine bound_table_response(self)
    type(closed_form_t), intent(inout) :: self   !! q on the panels is bounded
    integer :: i
    do i = 1, self%n
      associate (panel => self%panel(i))
        panel%q_sixth = sixth_of(panel%q, panel%half)
        panel%q_bernstein = bernstein_about(panel%q, panel%half)
        panel%q_rest = panel%q_sixth*panel%half**bound_order
      end associate
    end do
  end subroutine bound_table_response

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

  !> The response that is as slow as the flank, about x after a piece's beginning, its middle; see
  !> `has_slow_response`.
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
end module lapwing_flow_exact_response
