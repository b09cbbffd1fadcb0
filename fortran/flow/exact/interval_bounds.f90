!> Panels and table pieces in a row, bounded together: an arc over many of them passes most by the
!> block. A block holds the square root of their number, which makes the sum of blocks and members
!> that are looked at least. Of very many there are blocks of blocks: what is looked at grows with
!> the logarithm of their number.
module lapwing_flow_exact_interval_bounds
  use lapwing_kinds, only: wp
  use lapwing_flow_exact_panels, only: closed_form_t
  use lapwing_system_oscillation, only: free_matrix
  use lapwing_flank, only: flank_t
  implicit none
  private
  public :: blocks_t, row_t, make_blocks, widest_level, block_at, last_in_block

  !> Fewer than this are looked at one by one. Nothing but speed depends on it, and that little:
  !> with 24 or 96 a cycle over 16 to 192 knots takes up to a fifth more or a tenth less time.
  integer, parameter :: least_many = 48
  !> Of more than this there are several levels of blocks, `usual_fan` members each; sizes stay
  !> below 2**31.
  integer, parameter :: very_many = 10000, usual_fan = 32, most_levels = 5

  !> How a row of n members is cut into blocks. Members of a wider level are whole blocks.
  type :: row_t
    integer :: n = 0                        !! members
    integer :: levels = 0                   !! kinds of blocks, the smallest first; 0: no blocks
    integer :: size(most_levels) = 0        !! members of each
    integer :: before(most_levels + 1) = 0  !! blocks of the levels before
  end type row_t

  !> Bounds over panels in a row.
  type :: block_t
    real(wp) :: g_low = huge(1.0_wp), g_high = -huge(1.0_wp)   !! of g
    real(wp) :: q_low = huge(1.0_wp), q_high = -huge(1.0_wp)   !! of the response q
    !> Free oscillation from the middle of the first panel to that of the next block's.
    real(wp) :: d_matrix(2, 2) = 0
  end type block_t

  type :: blocks_t
    type(row_t) :: panels                   !! how panels are cut into blocks
    type(row_t) :: pieces                   !! and table pieces
    type(block_t), allocatable :: over(:)   !! blocks of panels, level after level
    real(wp), allocatable :: g_low(:)       !! bounds of g on blocks of pieces
    real(wp), allocatable :: g_high(:)
  end type blocks_t

contains

  !> Blocks of a scene's panels and of its flank's pieces.
  pure subroutine make_blocks(form, flank, self, error, fan)
    type(closed_form_t), intent(in) :: form    !! panels
    class(flank_t), intent(in) :: flank        !! g
    type(blocks_t), intent(out) :: self        !! blocks
    integer, intent(out) :: error              !! 0, or there is no memory for them
    integer, intent(in), optional :: fan       !! members of a block, of several levels whatever
                                               !! their number; default: by that
    error = 0
    self%panels = cut_row(form%n, fan)
    self%pieces = cut_row(flank%n, fan)
    if (self%panels%levels > 0) call gather_panels(self, form, flank, error)
    if (error /= 0) return
    if (self%pieces%levels > 0) call gather_pieces(self, flank, error)
  end subroutine make_blocks

  !> Blocks of n members.
  pure function cut_row(n, fan) result(row)
    integer, intent(in) :: n
    integer, intent(in), optional :: fan       !! members of a block
    type(row_t) :: row
    integer :: k, each
    row%n = n
    if (n < least_many) return
    each = usual_fan
    if (present(fan)) each = fan
    row%levels = 1
    if (n <= very_many .and. .not. present(fan)) then
      row%size(1) = nint(sqrt(real(n, wp)))
    else
      row%size(1) = each
      do k = 2, most_levels
        if (n/row%size(k - 1) <= each) exit
        row%size(k) = each*row%size(k - 1)
        row%levels = k
      end do
    end if
    do k = 1, row%levels
      row%before(k + 1) = row%before(k) + (n - 1)/row%size(k) + 1
    end do
  end function cut_row

  !> The widest kind of block that begins with a member; 0: none does.
  pure integer function widest_level(row, member) result(level)
    type(row_t), intent(in) :: row
    integer, intent(in) :: member
    do level = row%levels, 1, -1
      if (mod(member - 1, row%size(level)) == 0) return
    end do
    level = 0
  end function widest_level

  !> The block of a level that holds a member.
  pure integer function block_at(row, level, member)
    type(row_t), intent(in) :: row
    integer, intent(in) :: level
    integer, intent(in) :: member
    block_at = row%before(level) + (member - 1)/row%size(level) + 1
  end function block_at

  !> The last member of the block of a level that a member begins; of level 0 itself.
  pure integer function last_in_block(row, level, member) result(last)
    type(row_t), intent(in) :: row
    integer, intent(in) :: level
    integer, intent(in) :: member
    last = member
    if (level == 0) return
    last = row%n
    if (member <= row%n - row%size(level)) last = member + row%size(level) - 1
  end function last_in_block

  pure subroutine gather_panels(self, form, flank, error)
    type(blocks_t), intent(inout) :: self      !! blocks of panels are set
    type(closed_form_t), intent(in) :: form    !! panels
    class(flank_t), intent(in) :: flank        !! g
    integer, intent(out) :: error              !! 0, or there is no memory for them
    real(wp) :: low, high
    integer :: i, k, next
    associate (row => self%panels)
      allocate (self%over(row%before(row%levels + 1)), stat=error)
      if (error /= 0) return
      do i = 1, form%n
        associate (block => self%over(block_at(row, 1, i)), panel => form%panel(i))
          call flank%range(form%piece(i), form%edge(i) - flank%knot(form%piece(i)), &
              2*panel%half, low, high)
          block%g_low = min(block%g_low, low)
          block%g_high = max(block%g_high, high)
          block%q_low = min(block%q_low, minval(panel%q_bernstein) - panel%q_rest)
          block%q_high = max(block%q_high, maxval(panel%q_bernstein) + panel%q_rest)
        end associate
      end do
      do k = 1, row%levels
        do i = 1, form%n, row%size(k)
          if (k > 1) call join(self%over(block_at(row, k - 1, i):block_at(row, k - 1, &
              last_in_block(row, k, i))), self%over(block_at(row, k, i)))
          next = last_in_block(row, k, i) + 1
          if (next <= form%n) self%over(block_at(row, k, i))%d_matrix = &
              free_matrix(form%damping, form%panel(next)%middle - form%panel(i)%middle)
        end do
      end do
    end associate
  end subroutine gather_panels

  !> The bounds of several blocks as those of one.
  pure subroutine join(parts, whole)
    type(block_t), intent(in) :: parts(:)
    type(block_t), intent(inout) :: whole      !! its bounds are set
    whole%g_low = minval(parts%g_low)
    whole%g_high = maxval(parts%g_high)
    whole%q_low = minval(parts%q_low)
    whole%q_high = maxval(parts%q_high)
  end subroutine join

  pure subroutine gather_pieces(self, flank, error)
    type(blocks_t), intent(inout) :: self      !! blocks of pieces are set
    class(flank_t), intent(in) :: flank        !! g
    integer, intent(out) :: error              !! 0, or there is no memory for them
    real(wp) :: low, high
    integer :: i, k, level
    associate (row => self%pieces)
      allocate (self%g_low(row%before(row%levels + 1)), stat=error)
      if (error == 0) allocate (self%g_high(row%before(row%levels + 1)), stat=error)
      if (error /= 0) return
      self%g_low = huge(1.0_wp)
      self%g_high = -huge(1.0_wp)
      do i = 1, flank%n
        call flank%range(i, 0.0_wp, flank%knot(i + 1) - flank%knot(i), low, high)
        k = block_at(row, 1, i)
        self%g_low(k) = min(self%g_low(k), low)
        self%g_high(k) = max(self%g_high(k), high)
      end do
      do level = 2, row%levels
        do i = 1, flank%n, row%size(level - 1)
          k = block_at(row, level, i)
          self%g_low(k) = min(self%g_low(k), self%g_low(block_at(row, level - 1, i)))
          self%g_high(k) = max(self%g_high(k), self%g_high(block_at(row, level - 1, i)))
        end do
      end do
    end associate
  end subroutine gather_pieces
end module lapwing_flow_exact_interval_bounds
