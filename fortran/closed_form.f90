!> What the closed form of an oscillator's motion needs and no motion changes: steady response of
!> contact and its bounds, once for a scene.
!>
!> In contact the deflection is x = F + q(t) + d(s): q the periodic response to the flank's motion
!> alone, d a free oscillation that dies out. On a table piece q is a polynomial of degree three
!> plus a free oscillation of the piece's own; kinks and all other jumps are in q. Since
!> (d**2 + d'**2)' = -4 xi d'**2, the size E = |(d, d')| never grows: |d| <= E.
!>
!> The mesh period is cut into panels. On each the Bernstein coefficients of a polynomial of degree
!> five, less a bound of what it leaves out, are a rigorous bound of the function.
module lapwing_closed_form
  use lapwing_kinds, only: wp
  use lapwing_damped, only: damped_t, damped, free_matrix, n_taylor
  use lapwing_harmonic_series, only: harmonic_series_t, steady_response, expand_series, &
      bound_derivative, fastest_rate
  use lapwing_polynomial, only: max_degree, horner, horner_slope, taylor_shift, bernstein_on
  use lapwing_transmission_error, only: te_table_t
  implicit none
  private
  public :: closed_form_t, closed_form, locate_panel, free_size, bound_order, reach

  !> A panel in contact lasts at most this, so that the remainder of a free oscillation of size E
  !> is (0.75)**6/720 E = 2.5e-4 E; a harmonic of rate r has panels of this over r in flight.
  real(wp), parameter :: panel_span = 1.5_wp
  !> A Taylor series of order 13 is exact to rounding where rate*s is below this: the first term
  !> left out, (rate*s)**14/14!, against the second one, (rate*s)**2/2.
  real(wp), parameter :: reach = (epsilon(1.0_wp)*43589145600.0_wp)**(1.0_wp/12)
  !> Order of the first derivative that bounds leave out.
  integer, parameter :: bound_order = max_degree + 1
  integer, parameter :: cubic = max_degree - 2   !! degree of g''

  type :: closed_form_t
    logical :: harmonic = .false.                  !! g is a series, not a table
    type(harmonic_series_t) :: g, q                !! with a series: flank, response
    type(damped_t) :: damping                      !! damping in contact
    real(wp) :: free_bound = 0                     !! |d^(6)|/6! <= free_bound*E
    real(wp) :: g_bound = 0, q_bound = 0           !! with a series: |g^(6)|/6! and |q^(6)|/6!
    real(wp) :: fastest = 1                        !! rate that bounds a Taylor series' reach
    real(wp) :: period = 1                         !! mesh period
    real(wp) :: q_low = 0, q_high = 0              !! bounds of q
    real(wp) :: g_low = 0, g_high = 0              !! bounds of g, with a series
    ! Panels: n of them, on each the quantities about its beginning.
    integer :: n = 0
    real(wp), allocatable :: edge(:)               !! (n + 1) limits, tau
    integer, allocatable :: piece(:)               !! (n) table piece it lies in
    integer, allocatable :: look_up(:)             !! panel that holds a point of an even grid
    real(wp), allocatable :: q_begin(:, :)         !! (2, n) q and q' at its beginning
    real(wp), allocatable :: q_end(:, :)           !! (2, n) and end, before any jump there
    ! q of a table: its Taylor series where the panel is short, else a polynomial and a free part.
    logical, allocatable :: short(:)               !! (n) which
    real(wp), allocatable :: q_taylor(:, :)        !! (0:13, n)
    real(wp), allocatable :: free_begin(:, :)      !! (2, n) free part of q at its beginning
    real(wp), allocatable :: particular(:, :)      !! (0:3, n) polynomial part of q
    real(wp), allocatable :: q_sixth(:)            !! (n) bound of |q^(6)|/6!
    real(wp), allocatable :: q_bernstein(:, :)     !! (0:5, n) of q
    real(wp), allocatable :: q_rest(:)             !! (n) and what they leave out
    real(wp), allocatable :: g_bernstein(:, :)     !! (0:5, n) of g, with a series
    real(wp), allocatable :: g_rest(:)             !! (n) and what they leave out
    real(wp), allocatable :: g_taylor(:, :)        !! (0:5, n + 1) g about the edges, with a series
    real(wp), allocatable :: d_bernstein(:, :, :)  !! (0:5, 2, n) of d for unit d and d'
    real(wp), allocatable :: d_rest(:)             !! (n) what they leave out, over E
    real(wp), allocatable :: d_matrix(:, :, :)     !! (2, 2, n) d over the panel
  end type closed_form_t

contains

  !> Everything for one table or series and one damping ratio.
  pure function closed_form(table, series, harmonic, xi, period) result(self)
    type(te_table_t), intent(in) :: table           !! g as a table
    type(harmonic_series_t), intent(in) :: series   !! g as a series
    logical, intent(in) :: harmonic                 !! which of the two
    real(wp), intent(in) :: xi                      !! damping ratio
    real(wp), intent(in) :: period                  !! mesh period
    type(closed_form_t) :: self
    self%harmonic = harmonic
    self%period = period
    self%damping = damped(xi)
    self%free_bound = norm2(self%damping%row(:, bound_order))
    self%fastest = max(1.0_wp, 2*xi)
    if (harmonic) then
      self%g = series
      self%q = steady_response(series, xi)
      self%fastest = max(self%fastest, fastest_rate(series))
      self%g_bound = bound_derivative(self%g, bound_order)
      self%q_bound = bound_derivative(self%q, bound_order)
    end if
    call cut_panels(self, table)
    if (harmonic) then
      call sample_series(self)
    else
      call solve_table(self, table)
    end if
    call bound_free_part(self)
    if (.not. harmonic) call bound_table_response(self)
    self%q_low = minval(minval(self%q_bernstein, 1) - self%q_rest)
    self%q_high = maxval(maxval(self%q_bernstein, 1) + self%q_rest)
  end function closed_form

  !> Panels within table pieces, or even ones.
  pure subroutine cut_panels(self, table)
    type(closed_form_t), intent(inout) :: self      !! limits are set
    type(te_table_t), intent(in) :: table           !! g as a table
    integer :: parts(table%n), i, k, at
    real(wp) :: width
    parts = max(1, ceiling((table%knot(2:) - table%knot(:table%n))/panel_span))
    self%n = sum(parts)
    if (self%harmonic) self%n = max(4, ceiling(self%period*self%fastest/panel_span))
    allocate (self%edge(self%n + 1), self%piece(self%n))
    self%piece = 1
    if (self%harmonic) then
      self%edge = [(self%period*i/self%n, i = 0, self%n)]
    else
      at = 0
      do i = 1, table%n
        width = table%knot(i + 1) - table%knot(i)
        do k = 0, parts(i) - 1
          at = at + 1
          self%edge(at) = table%knot(i) + k*width/parts(i)
          self%piece(at) = i
        end do
      end do
    end if
    self%edge(self%n + 1) = self%period
    call make_look_up(self)
  end subroutine cut_panels

  !> For each cell of an even grid the panel at its beginning.
  pure subroutine make_look_up(self)
    type(closed_form_t), intent(inout) :: self      !! look_up is set
    integer :: i, panel
    allocate (self%look_up(0:2*self%n))
    panel = 1
    do i = 0, 2*self%n
      do while (panel < self%n)
        if (self%edge(panel + 1) > self%period*i/(2*self%n)) exit
        panel = panel + 1
      end do
      self%look_up(i) = panel
    end do
  end subroutine make_look_up

  !> The panel that holds t; at an edge the one that begins there.
  pure integer function locate_panel(self, t) result(panel)
    type(closed_form_t), intent(in) :: self    !! scene
    real(wp), intent(in) :: t                  !! time in the mesh period
    panel = self%look_up(min(2*self%n, int(t*(2*self%n)/self%period)))
    do while (panel < self%n)
      if (t < self%edge(panel + 1)) exit
      panel = panel + 1
    end do
    do while (panel > 1)
      if (t >= self%edge(panel)) exit
      panel = panel - 1
    end do
  end function locate_panel

  !> q and g of a series on the panels.
  pure subroutine sample_series(self)
    type(closed_form_t), intent(inout) :: self   !! q and g on the panels are set
    real(wp) :: taylor(0:max_degree), half
    integer :: i
    call allocate_response(self)
    allocate (self%g_bernstein(0:max_degree, self%n), self%g_rest(self%n))
    allocate (self%g_taylor(0:max_degree, self%n + 1))
    do i = 1, self%n
      half = 0.5_wp*(self%edge(i + 1) - self%edge(i))
      call expand_series(self%g, self%edge(i) + half, max_degree, taylor)
      self%g_bernstein(:, i) = about_middle(taylor, half)
      call expand_series(self%q, self%edge(i) + half, max_degree, taylor)
      self%q_bernstein(:, i) = about_middle(taylor, half)
      self%g_rest(i) = self%g_bound*half**bound_order
      self%q_rest(i) = self%q_bound*half**bound_order
      call expand_series(self%q, self%edge(i), max_degree, taylor)
      self%q_begin(:, i) = taylor(0:1)
      call expand_series(self%q, self%edge(i + 1), max_degree, taylor)
      self%q_end(:, i) = taylor(0:1)
    end do
    do i = 1, self%n + 1
      call expand_series(self%g, self%edge(i), max_degree, self%g_taylor(:, i))
    end do
    self%q_sixth = self%q_bound
    self%g_low = minval(minval(self%g_bernstein, 1) - self%g_rest)
    self%g_high = maxval(maxval(self%g_bernstein, 1) + self%g_rest)
  end subroutine sample_series

  pure subroutine allocate_response(self)
    type(closed_form_t), intent(inout) :: self   !! its arrays are allocated
    allocate (self%q_begin(2, self%n), self%q_end(2, self%n), self%free_begin(2, self%n))
    allocate (self%particular(0:cubic, self%n), self%q_taylor(0:n_taylor, self%n))
    allocate (self%short(self%n), self%q_sixth(self%n))
    self%short = .false.
    self%q_taylor = 0
    self%particular = 0
    self%free_begin = 0
    allocate (self%q_bernstein(0:max_degree, self%n), self%q_rest(self%n))
  end subroutine allocate_response

  !> Bernstein coefficients on a panel of a polynomial about its middle.
  pure function about_middle(taylor, half) result(b)
    real(wp), intent(in) :: taylor(0:max_degree)  !! coefficients about the middle
    real(wp), intent(in) :: half                  !! half its width
    real(wp) :: b(0:max_degree), c(0:max_degree)
    c = taylor
    call taylor_shift(c, -half)
    b = bernstein_on(c, 2*half)
  end function about_middle

  !> q of a table: a polynomial and a free part on each panel, joined over the knots and closed
  !> over the period.
  pure subroutine solve_table(self, table)
    type(closed_form_t), intent(inout) :: self      !! q on the panels is set
    type(te_table_t), intent(in) :: table           !! g as a table
    real(wp) :: matrix(2, 2), state(2), begin(2)
    integer :: i
    call allocate_response(self)
    do i = 1, self%n
      self%short(i) = (self%edge(i + 1) - self%edge(i))*self%fastest <= reach
      if (self%short(i)) then
        self%q_taylor(:, i) = forced_taylor(self%damping%xi, table, self%piece(i), &
            self%edge(i) - table%knot(self%piece(i)))
      else
        self%particular(:, i) = particular_solution(self%damping%xi, table, self%piece(i), &
            self%edge(i) - table%knot(self%piece(i)))
      end if
    end do
    state = 0
    matrix = reshape([1.0_wp, 0.0_wp, 0.0_wp, 1.0_wp], [2, 2])
    do i = 1, self%n
      state = over_panel(self, i, state)
      matrix = matmul(free_matrix(self%damping, self%edge(i + 1) - self%edge(i)), matrix)
      if (i < self%n) state(2) = state(2) - jump_after(self, table, i)
    end do
    ! The jump at phase 0 belongs to the period's end.
    state(2) = state(2) - table%slope_jump(1)
    begin = fixed_point(matrix, state)
    do i = 1, self%n
      self%q_begin(:, i) = begin
      self%q_end(:, i) = over_panel(self, i, begin)
      if (self%short(i)) then
        self%q_taylor(:, i) = self%q_taylor(:, i) + self%damping%row(1, :)*begin(1) &
            + self%damping%row(2, :)*begin(2)
      else
        self%free_begin(:, i) = begin - self%particular(0:1, i)
      end if
      begin = self%q_end(:, i)
      if (i < self%n) begin(2) = begin(2) - jump_after(self, table, i)
    end do
  end subroutine solve_table

  !> Polynomial solution of p'' + 2 xi p' + p = -g'' on a piece, about x after its beginning.
  pure function particular_solution(xi, table, piece, x) result(p)
    real(wp), intent(in) :: xi                 !! damping ratio
    type(te_table_t), intent(in) :: table      !! g as a table
    integer, intent(in) :: piece               !! piece
    real(wp), intent(in) :: x                  !! origin
    real(wp) :: p(0:cubic), g(0:max_degree), padded(0:max_degree)
    integer :: k
    g = table%coefficient(:, piece)
    if (x > 0) call taylor_shift(g, x)
    padded = 0
    do k = cubic, 0, -1
      padded(k) = -(k + 1)*((k + 2)*(g(k + 2) + padded(k + 2)) + 2*xi*padded(k + 1))
    end do
    p = padded(:cubic)
  end function particular_solution

  !> Taylor series about x after a piece's beginning of the response that begins at rest there. On a
  !> short panel it loses nothing, where polynomial and free part would all but cancel.
  pure function forced_taylor(xi, table, piece, x) result(c)
    real(wp), intent(in) :: xi                 !! damping ratio
    type(te_table_t), intent(in) :: table      !! g as a table
    integer, intent(in) :: piece               !! piece
    real(wp), intent(in) :: x                  !! origin
    real(wp) :: c(0:n_taylor), g(0:max_degree)
    integer :: k
    g = table%coefficient(:, piece)
    if (x > 0) call taylor_shift(g, x)
    c = 0
    do k = 2, n_taylor
      c(k) = -(2*xi*(k - 1)*c(k - 1) + c(k - 2))/real(k*(k - 1), wp)
      if (k <= max_degree) c(k) = c(k) - g(k)
    end do
  end function forced_taylor

  !> Response (x, x') at the end of a panel from that at its beginning.
  pure function over_panel(self, i, begin) result(finish)
    type(closed_form_t), intent(in) :: self    !! scene
    integer, intent(in) :: i                   !! panel
    real(wp), intent(in) :: begin(2)           !! x, x'
    real(wp) :: finish(2), width
    width = self%edge(i + 1) - self%edge(i)
    if (self%short(i)) then
      finish = matmul(free_matrix(self%damping, width), begin)
      finish(1) = finish(1) + horner(self%q_taylor(:, i), width)
      finish(2) = finish(2) + horner_slope(self%q_taylor(:, i), width)
      return
    end if
    finish = matmul(free_matrix(self%damping, width), begin - self%particular(0:1, i))
    finish(1) = finish(1) + horner(self%particular(:, i), width)
    finish(2) = finish(2) + horner_slope(self%particular(:, i), width)
  end function over_panel

  !> Jump of g' where a panel ends within the period.
  pure real(wp) function jump_after(self, table, i)
    type(closed_form_t), intent(in) :: self    !! scene
    type(te_table_t), intent(in) :: table      !! g as a table
    integer, intent(in) :: i                   !! panel
    jump_after = 0
    if (self%piece(i + 1) /= self%piece(i)) jump_after = table%slope_jump(self%piece(i + 1))
  end function jump_after

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

  !> Bernstein coefficients of a free oscillation on each panel, for unit d and unit d'.
  pure subroutine bound_free_part(self)
    type(closed_form_t), intent(inout) :: self   !! its arrays of d are set
    real(wp) :: half, middle(2, 2)
    integer :: i, k
    allocate (self%d_bernstein(0:max_degree, 2, self%n), self%d_rest(self%n))
    allocate (self%d_matrix(2, 2, self%n))
    do i = 1, self%n
      half = 0.5_wp*(self%edge(i + 1) - self%edge(i))
      middle = free_matrix(self%damping, half)
      do k = 1, 2
        self%d_bernstein(:, k, i) = about_middle(free_taylor(self, middle(:, k)), half)
      end do
      self%d_rest(i) = self%free_bound*half**bound_order
      self%d_matrix(:, :, i) = free_matrix(self%damping, 2*half)
    end do
  end subroutine bound_free_part

  !> Taylor coefficients of a free oscillation.
  pure function free_taylor(self, d) result(taylor)
    type(closed_form_t), intent(in) :: self    !! scene
    real(wp), intent(in) :: d(2)               !! d, d'
    real(wp) :: taylor(0:max_degree)
    taylor = self%damping%row(1, 0:max_degree)*d(1) + self%damping%row(2, 0:max_degree)*d(2)
  end function free_taylor

  !> Bernstein coefficients of q on the panels of a table.
  pure subroutine bound_table_response(self)
    type(closed_form_t), intent(inout) :: self   !! q on the panels is bounded
    real(wp) :: p(0:max_degree), width
    integer :: i
    do i = 1, self%n
      width = self%edge(i + 1) - self%edge(i)
      if (self%short(i)) then
        self%q_sixth(i) = sixth_of(self%q_taylor(:, i), width)
        self%q_bernstein(:, i) = bernstein_on(self%q_taylor(:max_degree, i), width)
        self%q_rest(i) = self%q_sixth(i)*width**bound_order
      else
        p = 0
        p(0:cubic) = self%particular(:, i)
        self%q_sixth(i) = self%free_bound*free_size(self%free_begin(:, i))
        self%q_bernstein(:, i) = bernstein_on(p, width) &
            + self%d_bernstein(:, 1, i)*self%free_begin(1, i) &
            + self%d_bernstein(:, 2, i)*self%free_begin(2, i)
        self%q_rest(i) = self%d_rest(i)*free_size(self%free_begin(:, i))
      end if
    end do
  end subroutine bound_table_response

  !> Bound of the sixth derivative over 6! of a polynomial on [0, width].
  pure real(wp) function sixth_of(c, width)
    real(wp), intent(in) :: c(0:n_taylor)      !! coefficients
    real(wp), intent(in) :: width              !! interval
    real(wp) :: choose
    integer :: k
    sixth_of = 0
    choose = 1
    do k = bound_order, n_taylor
      sixth_of = sixth_of + choose*abs(c(k))*width**(k - bound_order)
      choose = choose*(k + 1)/real(k + 1 - bound_order, wp)
    end do
  end function sixth_of

  !> Size of a free oscillation, from above.
  pure real(wp) function free_size(d)
    real(wp), intent(in) :: d(2)               !! d, d'
    free_size = sqrt(d(1)**2 + d(2)**2)
  end function free_size
end module lapwing_closed_form
