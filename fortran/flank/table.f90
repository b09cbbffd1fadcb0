!> The motion g of the drive flank over one mesh period: a periodic table of polynomial pieces.
module lapwing_flank_table
  use lapwing_kinds, only: wp
  use lapwing_polynomial_evaluation, only: max_degree, taylor_shift, value_and_slope, bernstein_on
  implicit none
  private
  public :: te_table_t, make_table, find_jumps, locate_piece, piece_at, expand_at, &
      flank_motion_at, lower_bound

  !> g(t) = sum_k coefficient(k,i) (t - knot(i))**k for knot(i) <= t < knot(i+1), t in [0, period).
  type :: te_table_t
    integer :: n = 0                               !! pieces
    real(wp), allocatable :: knot(:)               !! piece limits, (n + 1), units of tau
    real(wp), allocatable :: coefficient(:, :)     !! (0:5, n), rad per tau**k
    logical, allocatable :: kink(:)                !! (n + 1) slope jump at knot(i) is data
    real(wp), allocatable :: slope_jump(:)         !! (n + 1) g'(knot+) - g'(knot-)
    real(wp) :: cells_per_tau = 0                  !! of the grid of n equal cells
    integer, allocatable :: before_cell(:)         !! (0:n) pieces that begin before each cell
    real(wp) :: push(2) = 0                        !! bounds of g'' and -g'' between kinks,
                                                   !! rad per tau**2: what a flank can push with
    integer, allocatable :: next_kink(:)           !! (n) first kink or end after knot(i)
    integer, allocatable :: next_felt(:)           !! (n) or felt curvature jump
  end type te_table_t

contains

  !> Scale a table over mesh phase to the time and angle of an oscillator.
  pure subroutine make_table(knots, coefficients, kinks, scale, period, felt_curvature_jump, &
      table, error)
    real(wp), intent(in) :: knots(:)             !! (n + 1) mesh phase, 0 to 1
    real(wp), intent(in) :: coefficients(0:, :)  !! (0:5, n) rad per mesh period**k
    logical, intent(in) :: kinks(:)              !! (n) slope jump at knots(i)
    real(wp), intent(in) :: scale                !! from transmission error to g, +i12 or -i12
    real(wp), intent(in) :: period               !! mesh period in tau
    real(wp), intent(in) :: felt_curvature_jump  !! smallest jump of g'' at which steps must end
    type(te_table_t), intent(out) :: table       !! the table
    integer, intent(out) :: error                !! 0, or there is no memory for it
    integer :: n, i, k
    n = size(kinks)
    table%n = n
    allocate (table%knot(n + 1), stat=error)
    if (error == 0) allocate (table%coefficient(0:max_degree, n), stat=error)
    if (error == 0) allocate (table%kink(n + 1), stat=error)
    if (error == 0) allocate (table%slope_jump(n + 1), stat=error)
    if (error == 0) allocate (table%before_cell(0:n), stat=error)
    if (error == 0) allocate (table%next_kink(n), stat=error)
    if (error == 0) allocate (table%next_felt(n), stat=error)
    if (error /= 0) return
    do i = 1, n
      table%knot(i) = knots(i)*period
      table%kink(i) = kinks(i)
      do k = 0, max_degree
        table%coefficient(k, i) = scale*coefficients(k, i)/period**k
      end do
    end do
    table%knot(n + 1) = knots(n + 1)*period
    table%kink(n + 1) = kinks(1)
    table%cells_per_tau = n/period
    ! Knots in earlier cells, by counting those of each cell.
    table%before_cell = 0
    do i = 1, n
      k = cell_of(table, table%knot(i)) + 1
      table%before_cell(k) = table%before_cell(k) + 1
    end do
    do i = 1, n
      table%before_cell(i) = table%before_cell(i) + table%before_cell(i - 1)
    end do
    table%push = greatest_push(table)
    call find_jumps(table, felt_curvature_jump)
  end subroutine make_table

  !> Greatest g'' and -g'' that the pieces can have, by their Bernstein coefficients.
  pure function greatest_push(table) result(push)
    type(te_table_t), intent(in) :: table        !! table with pieces set
    real(wp) :: push(2), c(0:max_degree), b(0:max_degree)
    integer :: i, k
    push = -huge(push)
    do i = 1, table%n
      c = 0
      do k = 0, max_degree - 2
        c(k) = (k + 1)*(k + 2)*table%coefficient(k + 2, i)
      end do
      b = bernstein_on(c, table%knot(i + 1) - table%knot(i))
      push = [max(push(1), maxval(b)), max(push(2), -minval(b))]
    end do
  end function greatest_push

  !> Slope jumps, and for each piece the next knot where a step must end.
  pure subroutine find_jumps(table, felt_curvature_jump)
    type(te_table_t), intent(inout) :: table       !! table with pieces and kinks set
    real(wp), intent(in) :: felt_curvature_jump    !! rad per tau**2
    real(wp) :: before(0:max_degree), curvature_jump
    integer :: i, left, kink_after, felt_after
    kink_after = table%n + 1
    felt_after = table%n + 1
    do i = table%n, 1, -1
      left = merge(table%n, i - 1, i == 1)
      before = table%coefficient(:, left)
      call taylor_shift(before, table%knot(left + 1) - table%knot(left))
      table%slope_jump(i) = table%coefficient(1, i) - before(1)
      curvature_jump = 2*abs(table%coefficient(2, i) - before(2))
      table%next_kink(i) = kink_after
      table%next_felt(i) = felt_after
      if (table%kink(i)) kink_after = i
      if (table%kink(i) .or. curvature_jump > felt_curvature_jump) felt_after = i
    end do
    table%slope_jump(table%n + 1) = table%slope_jump(1)
  end subroutine find_jumps

  !> The piece that holds t; at a knot the piece that begins there.
  pure integer function locate_piece(table, t, guess) result(piece)
    type(te_table_t), intent(in) :: table  !! table
    real(wp), intent(in) :: t              !! time in the mesh period
    integer, intent(in) :: guess           !! where to look first
    piece = min(max(guess, 1), table%n)
    if (t >= table%knot(piece)) then
      if (t < table%knot(piece + 1) .or. piece == table%n) return
    end if
    piece = piece_at(table, t)
  end function locate_piece

  !> The same without a guess: one of the pieces that reach into the cell that holds t, most often
  !> the last.
  pure integer function piece_at(table, t) result(piece)
    type(te_table_t), intent(in) :: table  !! table
    real(wp), intent(in) :: t              !! time in the mesh period
    integer :: lower, middle, cell
    cell = cell_of(table, t)
    piece = max(table%before_cell(cell + 1), 1)
    if (t >= table%knot(piece)) return
    lower = max(table%before_cell(cell), 1)
    do while (piece - lower > 1)
      middle = (lower + piece)/2
      if (t >= table%knot(middle)) then
        lower = middle
      else
        piece = middle
      end if
    end do
    piece = lower
  end function piece_at

  !> The cell of the grid that holds t. It grows with t whatever the rounding, so that a knot in an
  !> earlier cell is earlier.
  pure integer function cell_of(table, t)
    type(te_table_t), intent(in) :: table  !! table
    real(wp), intent(in) :: t              !! time in the mesh period
    cell_of = min(int(t*table%cells_per_tau), table%n - 1)
  end function cell_of

  !> Taylor coefficients of g about t.
  pure subroutine expand_at(table, piece, t, local)
    type(te_table_t), intent(in) :: table           !! table
    integer, intent(in) :: piece                    !! piece that holds t
    real(wp), intent(in) :: t                       !! time in the mesh period
    real(wp), intent(out) :: local(0:max_degree)    !! coefficients about t
    local = table%coefficient(:, piece)
    if (t /= table%knot(piece)) call taylor_shift(local, t - table%knot(piece))
  end subroutine expand_at

  !> g and g' at t.
  pure subroutine flank_motion_at(table, t, guess, g, slope)
    type(te_table_t), intent(in) :: table  !! table
    real(wp), intent(in) :: t              !! time in the mesh period
    integer, intent(in) :: guess           !! piece to look at first
    real(wp), intent(out) :: g, slope      !! flank position and velocity
    integer :: piece
    real(wp) :: x
    piece = locate_piece(table, t, guess)
    x = t - table%knot(piece)
    call value_and_slope(table%coefficient(:, piece), x, g, slope)
  end subroutine flank_motion_at

  !> Lower bound of g from the sizes of each piece's terms.
  pure real(wp) function lower_bound(table)
    type(te_table_t), intent(in) :: table  !! table
    real(wp) :: width, spread
    integer :: i, k
    lower_bound = huge(lower_bound)
    do i = 1, table%n
      width = table%knot(i + 1) - table%knot(i)
      spread = 0
      do k = max_degree, 1, -1
        spread = (spread + abs(table%coefficient(k, i)))*width
      end do
      lower_bound = min(lower_bound, table%coefficient(0, i) - spread)
    end do
  end function lower_bound
end module lapwing_flank_table
