!> Panels and table pieces in a row, bounded together: an arc over many of them passes most by the
!> block. A block holds the square root of their number, which makes the sum of blocks and members
!> that are looked at least.
module lapwing_flow_exact_interval_bounds
  use lapwing_kinds, only: wp
  use lapwing_flow_exact_response, only: closed_form_t
  use lapwing_flow_exact_oscillation, only: free_matrix
  use lapwing_polynomial_evaluation, only: max_degree, bernstein_on, taylor_shift
  use lapwing_flank_table, only: te_table_t
  implicit none
  private
  public :: blocks_t, make_blocks

  !> Fewer than this are looked at one by one. Nothing but speed depends on it.
  integer, parameter :: least_many = 48

  !> Bounds over panels in a row.
  type :: block_t
    real(wp) :: g_low = huge(1.0_wp), g_high = -huge(1.0_wp)   !! of g
    real(wp) :: q_low = huge(1.0_wp), q_high = -huge(1.0_wp)   !! of the response q
    !> Free oscillation from the middle of the first panel to that of the next block's.
    real(wp) :: d_matrix(2, 2) = 0
  end type block_t

  type :: blocks_t
    integer :: panels = 0                   !! panels of a block; 0: they are too few for blocks
    integer :: pieces = 0                   !! table pieces of a block; 0: they are too few
    type(block_t), allocatable :: over(:)   !! blocks of panels
    real(wp), allocatable :: g_low(:)       !! bounds of g on blocks of pieces
    real(wp), allocatable :: g_high(:)
  end type blocks_t

contains

  !> Blocks of a scene's panels and of its table's pieces.
  pure subroutine make_blocks(form, table, self, error)
    type(closed_form_t), intent(in) :: form    !! panels
    type(te_table_t), intent(in) :: table      !! g as a table
    type(blocks_t), intent(out) :: self        !! blocks
    integer, intent(out) :: error              !! 0, or there is no memory for them
    error = 0
    if (form%n >= least_many) call gather_panels(self, form, table, error)
    if (error /= 0) return
    if (table%n >= least_many .and. .not. form%harmonic) call gather_pieces(self, table, error)
  end subroutine make_blocks

  pure subroutine gather_panels(self, form, table, error)
    type(blocks_t), intent(inout) :: self      !! blocks of panels are set
    type(closed_form_t), intent(in) :: form    !! panels
    type(te_table_t), intent(in) :: table      !! g as a table
    integer, intent(out) :: error              !! 0, or there is no memory for them
    real(wp) :: low, high
    integer :: i, next
    self%panels = nint(sqrt(real(form%n, wp)))
    allocate (self%over((form%n - 1)/self%panels + 1), stat=error)
    if (error /= 0) return
    do i = 1, form%n
      associate (block => self%over((i - 1)/self%panels + 1), panel => form%panel(i))
        call range_of_panel(form, table, i, low, high)
        block%g_low = min(block%g_low, low)
        block%g_high = max(block%g_high, high)
        block%q_low = min(block%q_low, minval(panel%q_bernstein) - panel%q_rest)
        block%q_high = max(block%q_high, maxval(panel%q_bernstein) + panel%q_rest)
        next = i + self%panels
        if (mod(i - 1, self%panels) == 0 .and. next <= form%n) block%d_matrix = &
            free_matrix(form%damping, form%panel(next)%middle - panel%middle)
      end associate
    end do
  end subroutine gather_panels

  !> Bounds of g on a panel.
  pure subroutine range_of_panel(form, table, i, low, high)
    type(closed_form_t), intent(in) :: form    !! panels
    type(te_table_t), intent(in) :: table      !! g as a table
    integer, intent(in) :: i                   !! panel
    real(wp), intent(out) :: low, high         !! bounds
    if (form%harmonic) then
      low = form%panel(i)%g_low
      high = form%panel(i)%g_high
    else
      call range_of_piece(table, form%piece(i), form%edge(i) - table%knot(form%piece(i)), &
          2*form%panel(i)%half, low, high)
    end if
  end subroutine range_of_panel

  !> Bounds of g on a part of a table piece.
  pure subroutine range_of_piece(table, piece, from, width, low, high)
    type(te_table_t), intent(in) :: table      !! g as a table
    integer, intent(in) :: piece               !! piece
    real(wp), intent(in) :: from, width        !! part, from the knot
    real(wp), intent(out) :: low, high         !! bounds
    real(wp) :: c(0:max_degree)
    c = table%coefficient(:, piece)
    call taylor_shift(c, from)
    c = bernstein_on(c, width)
    low = minval(c)
    high = maxval(c)
  end subroutine range_of_piece

  pure subroutine gather_pieces(self, table, error)
    type(blocks_t), intent(inout) :: self      !! blocks of pieces are set
    type(te_table_t), intent(in) :: table      !! g as a table
    integer, intent(out) :: error              !! 0, or there is no memory for them
    real(wp) :: low, high
    integer :: i, k
    self%pieces = nint(sqrt(real(table%n, wp)))
    k = (table%n - 1)/self%pieces + 1
    allocate (self%g_low(k), stat=error)
    if (error == 0) allocate (self%g_high(k), stat=error)
    if (error /= 0) return
    self%g_low = huge(1.0_wp)
    self%g_high = -huge(1.0_wp)
    do i = 1, table%n
      k = (i - 1)/self%pieces + 1
      call range_of_piece(table, i, 0.0_wp, table%knot(i + 1) - table%knot(i), low, high)
      self%g_low(k) = min(self%g_low(k), low)
      self%g_high(k) = max(self%g_high(k), high)
    end do
  end subroutine gather_pieces
end module lapwing_flow_exact_interval_bounds
