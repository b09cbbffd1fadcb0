!> A flank that does not move: g = 0.
module lapwing_flank_fixed
  use lapwing_flank, only: flank_t, set_knots
  use lapwing_kinds, only: wp
  use lapwing_polynomial_evaluation, only: max_degree
  implicit none
  private
  public :: fixed_flank_t, make_fixed_flank

  type, extends(flank_t) :: fixed_flank_t
  contains
    procedure :: taylor, motion, range, lower_bound
  end type fixed_flank_t

contains

  !> One piece over the period.
  pure subroutine make_fixed_flank(period, self, error)
    real(wp), intent(in) :: period                 !! mesh period in tau
    type(fixed_flank_t), intent(out) :: self       !! the flank
    integer, intent(out) :: error                  !! 0, or there is no memory for it
    call set_knots(self, [0.0_wp, 1.0_wp], [.false.], period, error)
  end subroutine make_fixed_flank

  pure subroutine taylor(self, piece, t, local)
    class(fixed_flank_t), intent(in) :: self
    integer, intent(in) :: piece                    !! without effect
    real(wp), intent(in) :: t                       !! without effect
    real(wp), intent(out) :: local(0:max_degree)    !! zero
    local = 0
  end subroutine taylor

  pure subroutine motion(self, t, guess, g, slope)
    class(fixed_flank_t), intent(in) :: self
    real(wp), intent(in) :: t                       !! without effect
    integer, intent(in) :: guess                    !! without effect
    real(wp), intent(out) :: g, slope               !! zero
    g = 0
    slope = 0
  end subroutine motion

  pure subroutine range(self, piece, from, width, low, high)
    class(fixed_flank_t), intent(in) :: self
    integer, intent(in) :: piece                    !! without effect
    real(wp), intent(in) :: from, width             !! without effect
    real(wp), intent(out) :: low, high              !! zero
    low = 0
    high = 0
  end subroutine range

  pure real(wp) function lower_bound(self)
    class(fixed_flank_t), intent(in) :: self
    lower_bound = 0
  end function lower_bound
end module lapwing_flank_fixed
