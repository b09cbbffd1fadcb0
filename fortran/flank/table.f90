!> A flank's motion as a periodic table of polynomial pieces.
module lapwing_flank_table
  use lapwing_flank, only: flank_t, set_knots, locate_piece
  use lapwing_kinds, only: wp
  use lapwing_polynomial_evaluation, only: max_degree, taylor_shift, shift_quintic, &
      value_and_slope, bernstein_on
  implicit none
  private
  public :: te_table_t, make_table, expand_at

  !> g(t) = sum_k coefficient(k,i) (t - knot(i))**k for knot(i) <= t < knot(i+1), t in [0, period).
  type, extends(flank_t) :: te_table_t
    real(wp), allocatable :: coefficient(:, :)     !! (0:5, n), rad per tau**k
  contains
    procedure :: taylor => expand_at
    procedure :: motion, range, lower_bound
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
    integer :: i, k
    call set_knots(table, knots, kinks, period, error)
    if (error == 0) allocate (table%coefficient(0:max_degree, table%n), stat=error)
    if (error /= 0) return
    do i = 1, table%n
      do k = 0, max_degree
        table%coefficient(k, i) = scale*coefficients(k, i)/period**k
      end do
    end do
    table%push = greatest_push(table)
    call find_jumps(table)
    call table%feel(felt_curvature_jump)
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

  !> Jumps of slope and curvature at knots, and for each piece the next kink.
  pure subroutine find_jumps(self)
    type(te_table_t), intent(inout) :: self        !! table with pieces set
    real(wp) :: before(0:max_degree)
    integer :: i, left, kink_after
    kink_after = self%n + 1
    do i = self%n, 1, -1
      left = merge(self%n, i - 1, i == 1)
      call shift_quintic(self%coefficient(:, left), self%knot(left + 1) - self%knot(left), before)
      self%slope_jump(i) = self%coefficient(1, i) - before(1)
      self%curvature_jump(i) = 2*abs(self%coefficient(2, i) - before(2))
      self%next_kink(i) = kink_after
      if (self%kink(i)) kink_after = i
    end do
    self%slope_jump(self%n + 1) = self%slope_jump(1)
    self%largest_jump = maxval(self%curvature_jump)
    self%next_felt = self%next_kink
  end subroutine find_jumps

  !> Taylor coefficients of g about t.
  pure subroutine expand_at(self, piece, t, local)
    class(te_table_t), intent(in) :: self
    integer, intent(in) :: piece                    !! piece that holds t
    real(wp), intent(in) :: t                       !! time in the mesh period
    real(wp), intent(out) :: local(0:max_degree)    !! coefficients about t
    if (t /= self%knot(piece)) then
      call shift_quintic(self%coefficient(:, piece), t - self%knot(piece), local)
    else
      local = self%coefficient(:, piece)
    end if
  end subroutine expand_at

  !> g and g' at t.
  pure subroutine motion(self, t, guess, g, slope)
    class(te_table_t), intent(in) :: self
    real(wp), intent(in) :: t              !! time in the mesh period
    integer, intent(in) :: guess           !! piece to look at first
    real(wp), intent(out) :: g, slope      !! flank position and velocity
    integer :: piece
    piece = locate_piece(self, t, guess)
    call value_and_slope(self%coefficient(:, piece), t - self%knot(piece), g, slope)
  end subroutine motion

  !> Bounds of g by the Bernstein coefficients of a part of a piece.
  pure subroutine range(self, piece, from, width, low, high)
    class(te_table_t), intent(in) :: self
    integer, intent(in) :: piece
    real(wp), intent(in) :: from, width    !! part, from the knot
    real(wp), intent(out) :: low, high     !! bounds
    real(wp) :: c(0:max_degree)
    c = self%coefficient(:, piece)
    call taylor_shift(c, from)
    c = bernstein_on(c, width)
    low = minval(c)
    high = maxval(c)
  end subroutine range

  !> Lower bound of g from the sizes of each piece's terms.
  pure real(wp) function lower_bound(self)
    class(te_table_t), intent(in) :: self
    real(wp) :: width, spread
    integer :: i, k
    lower_bound = huge(lower_bound)
    do i = 1, self%n
      width = self%knot(i + 1) - self%knot(i)
      spread = 0
      do k = max_degree, 1, -1
        spread = (spread + abs(self%coefficient(k, i)))*width
      end do
      lower_bound = min(lower_bound, self%coefficient(0, i) - spread)
    end do
  end function lower_bound
end module lapwing_flank_table
