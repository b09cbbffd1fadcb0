!> Panels and table pieces in a row, bounded together: an arc over many of them passes most by the
!> block. A block holds the square root of their number, which makes the sum of blocks and members
!> that are looked at least.
module lapwing_flow_exact_interval_bounds
  use lapwing_kinds, only: wp
  use lapwing_flow_exact_panels, only: closed_form_t
  use lapwing_system_oscillation, only: free_matrix
  use lapwing_flank, only: flank_t
  implicit none
  private
  public :: blocks_t, make_blocks

  !> Fewer than this are looked at one by one. Nothing but speed depends on it, and that little:
  !> with 24 or 96 a cycle over 16 to 192 knots takes up to a fifth more or a tenth less time.
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

  !> Blocks of a scene's panels and of its flank's pieces.
  pure subroutine make_blocks(form, flank, self, error)
    type(closed_form_t), intent(in) :: form    !! panels
    class(flank_t), intent(in) :: flank        !! g
    type(blocks_t), intent(out) :: self        !! blocks
    integer, intent(out) :: error              !! 0, or there is no memory for them
    error = 0
    if (form%n >= least_many) call gather_panels(self, form, flank, error)
    if (error /= 0) return
    if (flank%n >= least_many) call gather_pieces(self, flank, error)
  end subroutine make_blocks

  pure subroutine gather_panels(self, form, flank, error)
    type(blocks_t), intent(inout) :: self      !! blocks of panels are set
    type(closed_form_t), intent(in) :: form    !! panels
    class(flank_t), intent(in) :: flank        !! g
    integer, intent(out) :: error              !! 0, or there is no memory for them
    real(wp) :: low, high
    integer :: i, next
    self%panels = nint(sqrt(real(form%n, wp)))
    allocate (self%over((form%n - 1)/self%panels + 1), stat=error)
    if (error /= 0) return
    do i = 1, form%n
      associate (block => self%over((i - 1)/self%panels + 1), panel => form%panel(i))
        call flank%range(form%piece(i), form%edge(i) - flank%knot(form%piece(i)), 2*panel%half, &
            low, high)
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

  pure subroutine gather_pieces(self, flank, error)
    type(blocks_t), intent(inout) :: self      !! blocks of pieces are set
    class(flank_t), intent(in) :: flank        !! g
    integer, intent(out) :: error              !! 0, or there is no memory for them
    real(wp) :: low, high
    integer :: i, k
    self%pieces = nint(sqrt(real(flank%n, wp)))
    k = (flank%n - 1)/self%pieces + 1
    allocate (self%g_low(k), stat=error)
    if (error == 0) allocate (self%g_high(k), stat=error)
    if (error /= 0) return
    self%g_low = huge(1.0_wp)
    self%g_high = -huge(1.0_wp)
    do i = 1, flank%n
      k = (i - 1)/self%pieces + 1
      call flank%range(i, 0.0_wp, flank%knot(i + 1) - flank%knot(i), low, high)
      self%g_low(k) = min(self%g_low(k), low)
      self%g_high(k) = max(self%g_high(k), high)
    end do
  end subroutine gather_pieces
end module lapwing_flow_exact_interval_bounds
