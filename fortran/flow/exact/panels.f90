!> The closed form of an oscillator's motion on one flank, computed once for all its arcs: panels of
!> the mesh period, and on each the steady response of contact with its bounds.
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
!> (`lapwing_flow_exact_response`). A contact then ends at each knot, and what is fast is in
!> d, which `lapwing_flow_exact_slow_contact` follows as long as it lasts.
module lapwing_flow_exact_panels
  use lapwing_kinds, only: wp
  use lapwing_flank_series, only: harmonic_series_t
  use lapwing_flank_table, only: te_table_t
  use lapwing_polynomial_evaluation, only: max_degree, jet, bernstein_about
  use lapwing_system_oscillation, only: damped_t, free_matrix, n_taylor
  implicit none
  private
  public :: closed_form_t, panel_t, cut_evenly, cut_pieces, copy_panels, bound_free_part
  public :: locate_panel, response_at, response_on, free_size, ordinary_panels, reach
  public :: has_slow_response, panel_span, most_panels, bound_order

  !> A panel lasts at most this over the fastest rate: the first term that a series of order 15
  !> about its middle leaves out, (rate*half)**16/16!, is a quarter of a rounding, and what the
  !> first six terms leave out of a free oscillation of size E at most (0.66)**6/720 E = 1.1e-4 E.
  real(wp), parameter :: panel_span = &
      2*(0.25_wp*epsilon(1.0_wp)*20922789888000.0_wp)**(1.0_wp/16)
  !> Of a scene that is not graded, besides a table's pieces; some 60 MB.
  integer, parameter :: most_panels = 100000
  !> A Taylor series of order n is exact to rounding where rate*s is below its reach: the first term
  !> left out, (rate*s)**(n + 1)/(n + 1)!, against the second one, (rate*s)**2/2.
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
    real(wp) :: g_bend = 0                         !! |g'' - 2 g(2)| is no larger, with a series
    real(wp) :: d_rest = 0                         !! the same of d, over E in the middle
    real(wp) :: d_matrix(2, 2) = 0                 !! d from this middle to the next panel's
    real(wp) :: q_begin(2) = 0                     !! q and q' at its beginning
    real(wp) :: q_end(2) = 0                       !! and end, before any jump there
    real(wp) :: q_sixth = 0                        !! bound of |q^(6)|/6!
  end type panel_t

  type :: closed_form_t
    logical :: graded = .false.                    !! panels are short against the flank alone
    type(harmonic_series_t) :: q                   !! response to a series
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

  !> Panels that are short against all rates of a scene; a table has as many more as it has pieces,
  !> at most.
  pure real(wp) function ordinary_panels(period, rate)
    real(wp), intent(in) :: period                  !! mesh period
    real(wp), intent(in) :: rate                    !! fastest rate
    ordinary_panels = period*rate/panel_span
  end function ordinary_panels

  !> Even panels.
  pure subroutine cut_evenly(self, error)
    type(closed_form_t), intent(inout) :: self      !! limits are set
    integer, intent(out) :: error                   !! 0, or there is no memory for them
    integer :: i
    self%n = max(4, ceiling(self%period*merge(self%fastest_in_flight, self%fastest, self%graded) &
        /panel_span))
    call allocate_panels(self, error)
    if (error /= 0) return
    allocate (self%g_taylor(0:max_degree, self%n + 1), stat=error)
    if (error /= 0) return
    self%piece = 1
    do i = 0, self%n
      self%edge(i + 1) = self%period*i/self%n
    end do
    call set_middles(self)
  end subroutine cut_evenly

  !> Panels within the pieces of a table.
  pure subroutine cut_pieces(self, table, error)
    type(closed_form_t), intent(inout) :: self      !! limits are set
    type(te_table_t), intent(in) :: table           !! g as a table
    integer, intent(out) :: error                   !! 0, or there is no memory for them
    integer :: parts, i, k, at
    real(wp) :: width
    self%n = 0
    do i = 1, table%n
      self%n = self%n + parts_of(self, table, i)
    end do
    call allocate_panels(self, error)
    if (error /= 0) return
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
    call set_middles(self)
  end subroutine cut_pieces

  pure subroutine allocate_panels(self, error)
    type(closed_form_t), intent(inout) :: self      !! their number is known
    integer, intent(out) :: error                   !! 0, or there is no memory for them
    allocate (self%edge(self%n + 1), stat=error)
    if (error == 0) allocate (self%piece(self%n), stat=error)
    if (error == 0) allocate (self%panel(self%n), stat=error)
    if (error == 0) allocate (self%look_up(0:2*self%n), stat=error)
    if (error /= 0) self%n = 0
  end subroutine allocate_panels

  !> The same panels, with nothing on them, of one piece.
  pure subroutine copy_panels(form, self, error)
    type(closed_form_t), intent(in) :: form         !! panels are known
    type(closed_form_t), intent(inout) :: self      !! limits are set
    integer, intent(out) :: error                   !! 0, or there is no memory for them
    self%n = form%n
    call allocate_panels(self, error)
    if (error /= 0) return
    self%edge(:) = form%edge
    self%piece(:) = 1
    call set_middles(self)
  end subroutine copy_panels

  !> What follows from the beginnings of panels.
  pure subroutine set_middles(self)
    type(closed_form_t), intent(inout) :: self      !! its panels begin somewhere
    integer :: i
    self%edge(self%n + 1) = self%period
    do i = 1, self%n
      self%panel(i)%half = 0.5_wp*(self%edge(i + 1) - self%edge(i))
      self%panel(i)%middle = self%edge(i) + self%panel(i)%half
    end do
    call make_look_up(self)
  end subroutine set_middles

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

  !> Whether a piece has a response that is as slow as the flank: it must last long against the
  !> time constant of what the response leaves out, or its terms cancel.
  pure logical function has_slow_response(damping, width, span) result(has)
    type(damped_t), intent(in) :: damping
    real(wp), intent(in) :: width              !! of the piece
    real(wp), intent(in) :: span               !! time constants that count as long
    has = width*max(1.0_wp, 2*damping%xi) > span
    if (has .and. .not. damping%apart) has = width*damping%slow_rate >= span
  end function has_slow_response

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
  !> Bernstein coefficients of a free oscillation on each panel, for unit d and unit d'.
  pure subroutine bound_free_part(self)
    type(closed_form_t), intent(inout) :: self   !! what it needs of d is set
    integer :: i, k
    do i = 1, self%n
      associate (panel => self%panel(i))
        do k = 1, 2
          panel%d_bernstein(:, k) = bernstein_about(self%damping%unit(:, k), panel%half)
        end do
        ! E falls by exp(-2 xi s) at most: at the beginning it is at most this much larger.
        panel%d_rest = self%free_bound*panel%half**bound_order &
            *exp(2*self%damping%xi*panel%half)
        if (i < self%n) panel%d_matrix = free_matrix(self%damping, &
            self%panel(i + 1)%middle - panel%middle)
      end associate
    end do
  end subroutine bound_free_part

  !> q and q' at a time of the cycle, after what happens there.
  pure function response_at(self, t) result(q)
    type(closed_form_t), intent(in) :: self    !! scene
    real(wp), intent(in) :: t                  !! time in the cycle
    real(wp) :: q(2)
    integer :: panel
    panel = locate_panel(self, t)
    if (t == self%edge(panel)) then
      q = self%panel(panel)%q_begin
    else
      q = response_on(self%panel(panel), t)
    end if
  end function response_at

  !> q and q' at a time within a panel.
  pure function response_on(panel, t) result(q)
    type(panel_t), intent(in) :: panel
    real(wp), intent(in) :: t                  !! time in the cycle
    real(wp) :: q(2), bend
    call jet(n_taylor, panel%q, t - panel%middle, q(1), q(2), bend)
  end function response_on
end module lapwing_flow_exact_panels
