!> A flank's motion g over one mesh period. Between its knots it is smooth; at a kink its slope
!> jumps. What g is there, a polynomial, a series or nothing, is the affair of the type.
module lapwing_flank
  use lapwing_kinds, only: wp
  use lapwing_polynomial_evaluation, only: max_degree
  implicit none
  private
  public :: flank_t, set_knots, locate_piece, piece_at

  type, abstract :: flank_t
    integer :: n = 0                               !! pieces between knots
    real(wp), allocatable :: knot(:)               !! limits of the pieces, (n + 1), units of tau
    logical, allocatable :: kink(:)                !! (n + 1) slope jump at knot(i) is data
    real(wp), allocatable :: slope_jump(:)         !! (n + 1) g'(knot+) - g'(knot-)
    real(wp) :: push(2) = 0                        !! bounds of g'' and -g'' between kinks,
                                                   !! rad per tau**2: what a flank can push with
    real(wp), allocatable :: curvature_jump(:)     !! (n) abs(g''(knot+) - g''(knot-))
    real(wp) :: largest_jump = 0                   !! of those
    integer, allocatable :: next_kink(:)           !! (n) first kink or end after knot(i)
    integer, allocatable :: next_felt(:)           !! (n) or felt curvature jump
    logical :: feels = .false.                     !! whether next_felt is another than next_kink
    real(wp) :: cells_per_tau = 0                  !! of the grid of n equal cells
    integer, allocatable :: before_cell(:)         !! (0:n) pieces that begin before each cell
  contains
    procedure(taylor_i), deferred :: taylor
    procedure(motion_i), deferred :: motion
    procedure(range_i), deferred :: range
    procedure(lower_bound_i), deferred :: lower_bound
    procedure :: feel
  end type flank_t

  abstract interface
    !> Taylor coefficients of g about t, towards later times. Of a table they are all there are.
    pure subroutine taylor_i(self, piece, t, local)
      import :: flank_t, max_degree, wp
      implicit none
      class(flank_t), intent(in) :: self
      integer, intent(in) :: piece                    !! piece that holds t
      real(wp), intent(in) :: t                       !! time in the mesh period
      real(wp), intent(out) :: local(0:max_degree)    !! coefficients
    end subroutine taylor_i

    !> g and g' at t.
    pure subroutine motion_i(self, t, guess, g, slope)
      import :: flank_t, wp
      implicit none
      class(flank_t), intent(in) :: self
      real(wp), intent(in) :: t                       !! time in the mesh period
      integer, intent(in) :: guess                    !! piece to look at first
      real(wp), intent(out) :: g, slope               !! position and velocity
    end subroutine motion_i

    !> Bounds of g over an interval of a piece.
    pure subroutine range_i(self, piece, from, width, low, high)
      import :: flank_t, wp
      implicit none
      class(flank_t), intent(in) :: self
      integer, intent(in) :: piece
      real(wp), intent(in) :: from, width             !! interval, from the piece's knot
      real(wp), intent(out) :: low, high              !! bounds
    end subroutine range_i

    !> Lower bound of g at all times.
    pure real(wp) function lower_bound_i(self)
      import :: flank_t, wp
      implicit none
      class(flank_t), intent(in) :: self
    end function lower_bound_i
  end interface

contains

  !> Pieces and kinks, and the grid that finds a piece.
  pure subroutine set_knots(self, knots, kinks, period, error)
    class(flank_t), intent(inout) :: self
    real(wp), intent(in) :: knots(:)               !! (n + 1) mesh phase, 0 to 1
    logical, intent(in) :: kinks(:)                !! (n) slope jump at knots(i)
    real(wp), intent(in) :: period                 !! mesh period in tau
    integer, intent(out) :: error                  !! 0, or there is no memory for them
    integer :: n, i, k
    n = size(kinks)
    self%n = n
    allocate (self%knot(n + 1), stat=error)
    if (error == 0) allocate (self%kink(n + 1), stat=error)
    if (error == 0) allocate (self%slope_jump(n + 1), stat=error)
    if (error == 0) allocate (self%before_cell(0:n), stat=error)
    if (error == 0) allocate (self%curvature_jump(n), stat=error)
    if (error == 0) allocate (self%next_kink(n), stat=error)
    if (error == 0) allocate (self%next_felt(n), stat=error)
    if (error /= 0) return
    do i = 1, n
      self%knot(i) = knots(i)*period
      self%kink(i) = kinks(i)
    end do
    self%knot(n + 1) = knots(n + 1)*period
    self%kink(n + 1) = kinks(1)
    self%slope_jump = 0
    self%curvature_jump = 0
    self%next_kink = n + 1
    self%next_felt = n + 1
    self%cells_per_tau = n/period
    ! Knots in earlier cells, by counting those of each cell.
    self%before_cell = 0
    do i = 1, n
      k = cell_of(self, self%knot(i)) + 1
      self%before_cell(k) = self%before_cell(k) + 1
    end do
    do i = 1, n
      self%before_cell(i) = self%before_cell(i) + self%before_cell(i - 1)
    end do
  end subroutine set_knots

  !> Where a step in contact must end: for each piece the next kink or felt curvature jump.
  pure subroutine feel(self, felt_curvature_jump)
    class(flank_t), intent(inout) :: self
    real(wp), intent(in) :: felt_curvature_jump    !! rad per tau**2
    integer :: i, felt_after
    if (.not. self%largest_jump > felt_curvature_jump) then
      ! Asked anew for every force of a sweep: nothing to do for most.
      if (self%feels) self%next_felt = self%next_kink
      self%feels = .false.
      return
    end if
    self%feels = .true.
    felt_after = self%n + 1
    do i = self%n, 1, -1
      self%next_felt(i) = felt_after
      if (self%kink(i) .or. self%curvature_jump(i) > felt_curvature_jump) felt_after = i
    end do
  end subroutine feel

  !> The piece that holds t; at a knot the piece that begins there.
  pure integer function locate_piece(self, t, guess) result(piece)
    class(flank_t), intent(in) :: self
    real(wp), intent(in) :: t              !! time in the mesh period
    integer, intent(in) :: guess           !! where to look first
    piece = min(max(guess, 1), self%n)
    if (t >= self%knot(piece)) then
      if (t < self%knot(piece + 1) .or. piece == self%n) return
    end if
    piece = piece_at(self, t)
  end function locate_piece

  !> The same without a guess: one of the pieces that reach into the cell that holds t, most often
  !> the last.
  pure integer function piece_at(self, t) result(piece)
    class(flank_t), intent(in) :: self
    real(wp), intent(in) :: t              !! time in the mesh period
    integer :: lower, middle, cell
    cell = cell_of(self, t)
    piece = max(self%before_cell(cell + 1), 1)
    if (t >= self%knot(piece)) return
    lower = max(self%before_cell(cell), 1)
    do while (piece - lower > 1)
      middle = (lower + piece)/2
      if (t >= self%knot(middle)) then
        lower = middle
      else
        piece = middle
      end if
    end do
    piece = lower
  end function piece_at

  !> The cell of the grid that holds t. It grows with t whatever the rounding, so that a knot in an
  !> earlier cell is earlier.
  pure integer function cell_of(self, t)
    class(flank_t), intent(in) :: self
    real(wp), intent(in) :: t              !! time in the mesh period
    cell_of = min(int(t*self%cells_per_tau), self%n - 1)
  end function cell_of
end module lapwing_flank
