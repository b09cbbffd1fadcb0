!> What the closed form of an oscillator's motion needs and no motion changes: steady response of
!> contact and its bounds, once for a scene.
!>
!> In contact the deflection is x = F + q(t) + d(s): q the periodic response to the flank's motion
!> alone, d a free oscillation that dies out. Kinks and all other jumps are in q. Since
!> (d**2 + d'**2)' = -4 xi d'**2, the size E = |(d, d')| never grows: |d| <= E.
!>
!> The mesh period is cut into panels, short enough that Taylor series about their middles are exact
!> to rounding. Bernstein coefficients of the first six terms, less a bound of what these leave out,
!> are a rigorous bound of the function.
!>
!> Where the mesh is so slow against the spring or the damper that this would take too many panels,
!> the scene is *graded*: panels are short against the flank's motion alone, a table's pieces are
!> one panel each but for a few, and q is the response that moves with its piece alone
!> (`lapwing_flow_exact_piece_response`). A contact then ends at each knot, and what is fast is in
!> d, which `lapwing_flow_exact_slow_contact` follows as long as it lasts.
module lapwing_flow_exact_response
  use lapwing_kinds, only: wp
  use lapwing_flow_exact_oscillation, only: damped_t, damped, free_matrix, n_taylor
  use lapwing_flank_series, only: harmonic_series_t, steady_response, expand_series, series_at, &
      bound_derivative, fastest_rate
  use lapwing_polynomial_evaluation, only: max_degree, horner, horner_slope, taylor_shift, &
      bernstein_on
  use lapwing_flow_exact_piece_response, only: forced_taylor, fixed_point, sixth_of, &
      has_slow_response, slow_response
  use lapwing_flank_table, only: te_table_t
  implicit none
  private
  public :: closed_form_t, panel_t, make_closed_form, locate_panel, free_size, bound_order
  public :: launch_order, reach, ordinary_panels, most_panels

  !> A panel lasts at most this over the fastest rate: the first term that a series of order 15
  !> about its middle leaves out, (rate*half)**16/16!, is a quarter of a rounding, and what the
  !> first six terms leave out of a free oscillation of size E at most (0.66)**6/720 E = 1.1e-4 E.
  real(wp), parameter :: panel_span = &
      2*(0.25_wp*epsilon(1.0_wp)*20922789888000.0_wp)**(1.0_wp/16)
  integer, parameter :: most_panels = 100000   !! of a scene that is not graded; some 70 MB
  !> A Taylor series of order n is exact to rounding where rate*s is below its reach: the first term
  !> left out, (rate*s)**(n + 1)/(n + 1)!, against the second one, (rate*s)**2/2.
  integer, parameter :: launch_order = 13   !! highest order of a series about a launch
  real(wp), parameter :: half_factorial(5) = [360.0_wp, 20160.0_wp, 1814400.0_wp, &
      239500800.0_wp, 43589145600.0_wp]     !! (n + 1)!/2 for n = 5, 7, ... 13
  real(wp), parameter :: reaches(5) = (epsilon(1.0_wp)*half_factorial) &
      **(1/[4.0_wp, 6.0_wp, 8.0_wp, 10.0_wp, 12.0_wp])
  !> Order of the first derivative that bounds leave out.
  integer, parameter :: bound_order = max_degree + 1

  !> One panel; series are about its middle.
  type :: panel_t
    real(wp) :: middle = 0, half = 0               !! cycle time and half its width, tau
    real(wp) :: g_low = 0, g_high = 0              !! bounds of g, with a series
    real(wp) :: g(0:n_taylor) = 0                  !! Taylor series of g, with a series
    real(wp) :: q(0:n_taylor) = 0                  !! and of q
    real(wp) :: g_bernstein(0:max_degree) = 0      !! Bernstein coefficients of g, with a series
    real(wp) :: q_bernstein(0:max_degree) = 0      !! and of q
    real(wp) :: d_bernstein(0:max_degree, 2) = 0   !! of d for unit d and d' at the middle
    real(wp) :: g_rest = 0, q_rest = 0             !! what they leave out
    real(wp) :: d_rest = 0                         !! the same of d, over E in the middle
    real(wp) :: d_matrix(2, 2) = 0                 !! d from this middle to the next panel's
    real(wp) :: q_begin(2) = 0                     !! q and q' at its beginning
    real(wp) :: q_end(2) = 0                       !! and end, before any jump there
    real(wp) :: q_sixth = 0                        !! bound of |q^(6)|/6!
  end type panel_t

  type :: closed_form_t
    logical :: harmonic = .false.                  !! g is a series, not a table
    logical :: graded = .false.                    !! panels are short against the flank alone
    type(harmonic_series_t) :: g, q                !! with a series: flank, response
    type(damped_t) :: damping                      !! damping in contact
    real(wp) :: free_bound = 0                     !! |d^(6)|/6! <= free_bound*E
    real(wp) :: g_bound = 0, q_bound = 0           !! with a series: |g^(6)|/6! and |q^(6)|/6!
    real(wp) :: fastest = 1                        !! rate that bounds a Taylor series' reach
    real(wp) :: fastest_in_flight = 0              !! and a series' own, of flights
    real(wp) :: period = 1                         !! mesh period
    real(wp) :: q_low = 0, q_high = 0              !! bounds of q
    real(wp) :: g_low = 0, g_high = 0              !! bounds of g, with a series
    integer :: n = 0                               !! panels
    real(wp), allocatable :: edge(:)               !! (n + 1) limits, tau
    integer, allocatable :: piece(:)               !! (n) table piece it lies in
    integer, allocatable :: look_up(:)             !! panel that holds a point of an even grid
    real(wp) :: cells = 1                          !! cells of that grid, per tau
    type(panel_t), allocatable :: panel(:)         !! (n)
    real(wp), allocatable :: g_taylor(:, :)        !! (0:5, n + 1) g about the edges, with a series
  end type closed_form_t

contains

  !> Everything for one table or series and one damping ratio.
  pure subroutine make_closed_form(table, series, harmonic, xi, period, most, self, error)
    type(te_table_t), intent(in) :: table           !! g as a table
    type(harmonic_series_t), intent(in) :: series   !! g as a series
    logical, intent(in) :: harmonic                 !! which of the two
    real(wp), intent(in) :: xi                      !! damping ratio
    real(wp), intent(in) :: period                  !! mesh period
    integer, intent(in) :: most                     !! panels, before the scene is graded
    type(closed_form_t), intent(out) :: self        !! the closed form
    integer, intent(out) :: error                   !! 0, or there is no memory for it
    integer :: i
    self%harmonic = harmonic
    self%period = period
    self%damping = damped(xi)
    self%free_bound = norm2(self%damping%row(:, bound_order))
    self%fastest = max(1.0_wp, 2*xi)
    if (harmonic) then
      self%g = series
      self%q = steady_response(series, xi)
      ! Without terms the series reaches as far as numbers do.
      self%fastest_in_flight = max(fastest_rate(series), tiny(1.0_wp))
      self%fastest = max(self%fastest, self%fastest_in_flight)
      self%g_bound = bound_derivative(self%g, bound_order)
      self%q_bound = bound_derivative(self%q, bound_order)
    end if
    self%graded = ordinary_panels(period, self%fastest, merge(0, table%n, harmonic)) > most
    call cut_panels(self, table, error)
    if (error /= 0) return
    if (harmonic) then
      call sample_series(self)
    else if (self%graded) then
      call solve_pieces(self, table)
    else
      call solve_table(self, table)
    end if
    if (.not. self%graded) call bound_free_part(self)
    if (.not. harmonic) call bound_table_response(self)
    self%q_low = huge(1.0_wp)
    self%q_high = -huge(1.0_wp)
    do i = 1, self%n
      self%q_low = min(self%q_low, minval(self%panel(i)%q_bernstein) - self%panel(i)%q_rest)
      self%q_high = max(self%q_high, maxval(self%panel(i)%q_bernstein) + self%panel(i)%q_rest)
    end do
  end subroutine make_closed_form

  !> Panels that are short against all rates of a scene, at most.
  pure real(wp) function ordinary_panels(period, rate, pieces)
    real(wp), intent(in) :: period                  !! mesh period
    real(wp), intent(in) :: rate                    !! fastest rate
    integer, intent(in) :: pieces                   !! of a table; 0 with a series
    ordinary_panels = period*rate/panel_span + pieces
  end function ordinary_panels

  !> Panels within table pieces, or even ones.
  pure subroutine cut_panels(self, table, error)
    type(closed_form_t), intent(inout) :: self      !! limits are set
    type(te_table_t), intent(in) :: table           !! g as a table
    integer, intent(out) :: error                   !! 0, or there is no memory for them
    integer :: parts, i, k, at
    real(wp) :: width, rate
    self%n = 0
    if (self%harmonic) then
      rate = merge(self%fastest_in_flight, self%fastest, self%graded)
      self%n = max(4, ceiling(self%period*rate/panel_span))
    else
      do i = 1, table%n
        self%n = self%n + parts_of(self, table, i)
      end do
    end if
    allocate (self%edge(self%n + 1), stat=error)
    if (error == 0) allocate (self%piece(self%n), stat=error)
    if (error == 0) allocate (self%panel(self%n), stat=error)
    if (error == 0) allocate (self%look_up(0:2*self%n), stat=error)
    if (error == 0 .and. self%harmonic) allocate (self%g_taylor(0:max_degree, self%n + 1), &
        stat=error)
    if (error /= 0) return
    self%piece = 1
    if (self%harmonic) then
      do i = 0, self%n
        self%edge(i + 1) = self%period*i/self%n
      end do
    else
      at = 0
      do i = 1, table%n
        width = table%knot(i + 1) - table%knot(i)
        parts = parts_of(self, table, i)
        do k = 0, parts - 1
          at = at + 1
          self%edge(at) = table%knot(i) + k*width/parts
          self%piece(at) = i
        end do
      end do
    end if
    self%edge(self%n + 1) = self%period
    do i = 1, self%n
      self%panel(i)%half = 0.5_wp*(self%edge(i + 1) - self%edge(i))
      self%panel(i)%middle = self%edge(i) + self%panel(i)%half
    end do
    call make_look_up(self)
  end subroutine cut_panels

  !> Panels of a table piece.
  pure integer function parts_of(self, table, i)
    type(closed_form_t), intent(in) :: self         !! its fastest rate
    type(te_table_t), intent(in) :: table           !! g as a table
    integer, intent(in) :: i                        !! piece
    real(wp) :: width
    width = table%knot(i + 1) - table%knot(i)
    parts_of = 1
    if (self%graded) then
      if (has_slow_response(self%damping, width, panel_span)) return
    end if
    parts_of = max(1, ceiling(width*self%fastest/panel_span))
  end function parts_of

  !> For each cell of an even grid the panel at its beginning.
  pure subroutine make_look_up(self)
    type(closed_form_t), intent(inout) :: self      !! look_up is set
    integer :: i, panel
    self%cells = 2*self%n/self%period
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
    panel = self%look_up(min(2*self%n, int(t*self%cells)))
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
    integer :: i
    do i = 1, self%n
      associate (panel => self%panel(i))
        call expand_series(self%g, panel%middle, n_taylor, panel%g)
        call expand_series(self%q, panel%middle, n_taylor, panel%q)
        panel%g_bernstein = about_middle(panel%g, panel%half)
        panel%q_bernstein = about_middle(panel%q, panel%half)
        panel%g_rest = self%g_bound*panel%half**bound_order
        panel%q_rest = self%q_bound*panel%half**bound_order
        panel%g_low = minval(panel%g_bernstein) - panel%g_rest
        panel%g_high = maxval(panel%g_bernstein) + panel%g_rest
        call series_at(self%q, self%edge(i), panel%q_begin(1), panel%q_begin(2))
        call series_at(self%q, self%edge(i + 1), panel%q_end(1), panel%q_end(2))
        panel%q_sixth = self%q_bound
      end associate
    end do
    do i = 1, self%n + 1
      call expand_series(self%g, self%edge(i), max_degree, self%g_taylor(:, i))
    end do
    self%g_low = minval(self%panel%g_low)
    self%g_high = maxval(self%panel%g_high)
  end subroutine sample_series

  !> Bernstein coefficients on a panel of the first terms of a series about its middle.
  pure function about_middle(taylor, half) result(b)
    real(wp), intent(in) :: taylor(0:)            !! coefficients about the middle
    real(wp), intent(in) :: half                  !! half its width
    real(wp) :: b(0:max_degree), c(0:max_degree)
    c = taylor(0:max_degree)
    call taylor_shift(c, -half)
    b = bernstein_on(c, 2*half)
  end function about_middle

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

  !> Bernstein coefficients of a free oscillation on each panel, for unit d and unit d'.
  pure subroutine bound_free_part(self)
    type(closed_form_t), intent(inout) :: self   !! what it needs of d is set
    integer :: i, k
    do i = 1, self%n
      associate (panel => self%panel(i))
        do k = 1, 2
          panel%d_bernstein(:, k) = about_middle(self%damping%unit(:, k), panel%half)
        end do
        ! E falls by exp(-2 xi s) at most: at the beginning it is at most this much larger.
        panel%d_rest = self%free_bound*panel%half**bound_order &
            *exp(2*self%damping%xi*panel%half)
        if (i < self%n) panel%d_matrix = free_matrix(self%damping, &
            self%panel(i + 1)%middle - panel%middle)
      end associate
    end do
  end subroutine bound_free_part

  !> Bernstein coefficients of q on the panels of a table.
  pure subroutine bound_table_response(self)
    type(closed_form_t), intent(inout) :: self   !! q on the panels is bounded
    integer :: i
    do i = 1, self%n
      associate (panel => self%panel(i))
        panel%q_sixth = sixth_of(panel%q, panel%half)
        panel%q_bernstein = about_middle(panel%q, panel%half)
        panel%q_rest = panel%q_sixth*panel%half**bound_order
      end associate
    end do
  end subroutine bound_table_response

  !> Reach of a series of an odd order from five on.
  pure real(wp) function reach(n)
    integer, intent(in) :: n                   !! order
    reach = reaches((n - 3)/2)
  end function reach

  !> Size of a free oscillation, from above.
  pure real(wp) function free_size(d)
    real(wp), intent(in) :: d(2)               !! d, d'
    free_size = sqrt(d(1)**2 + d(2)**2)
  end function free_size
end module lapwing_flow_exact_response
