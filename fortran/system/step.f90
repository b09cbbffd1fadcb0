!> What a step of the classical formula gives, and the weights of the formula. The formula itself is
!> in flow/rk4/step.f90; a system whose equations allow it writes its stages out (`stages`).
module lapwing_system_step
  use lapwing_kinds, only: wp
  use lapwing_flank_series, only: max_terms
  implicit none
  private
  public :: step_t, kept_t, lengths_t, max_states, richardson, sixth, change

  integer, parameter :: max_states = 8            !! largest number of state variables

  !> 1/(2**4 - 1): two half steps of a fourth-order formula against the whole one.
  real(wp), parameter :: richardson = 1.0_wp/15
  !> Products for quotients: stages wait for each other, and a division takes three times as long.
  real(wp), parameter :: third = 1.0_wp/3, sixth = 1.0_wp/6

  !> What the stages of a step give. Nothing is set beforehand: a step is too short for that.
  type :: step_t
    real(wp) :: middle(max_states)        !! local coordinates at s = h/2
    real(wp) :: end(max_states)           !! and at s = h
    real(wp) :: correction(max_states)    !! extrapolation at s = h: the error without it
    real(wp) :: rate_begin(max_states)    !! derivatives at s = 0
    real(wp) :: rate_middle(max_states)   !! at s = h/2
    real(wp) :: rate_end(max_states)      !! at s = h, where dense output is wanted
    real(wp) :: landing(2)                !! position and velocity of the chart's flank at s = h, in
                                          !! the frame, of a system that knows when it stays
  end type step_t

  !> What the stages of a damped spring need of the length of a step, and of nothing else: the same
  !> few lengths come again and again.
  type :: kept_t
    real(wp) :: h                         !! the length
    !> Middle, end and correction, position and velocity each, for unit position and velocity at
    !> s = 0 and unit force at the quarters.
    real(wp) :: response(6, 6)
    !> Force at the quarters, position and velocity of the flank at the end, for a harmonic that
    !> begins as a unit cosine and as a unit sine.
    real(wp) :: from_cosine(6, max_terms), from_sine(6, max_terms)
  end type kept_t

  !> The lengths of late.
  type :: lengths_t
    real(wp) :: h(8) = -1                 !! each; negative: nothing is known
    type(kept_t) :: kept(8)               !! what is known of it
    integer :: at = 1                     !! which of them the step at hand has
    integer :: oldest = 1                 !! which of them to forget next
  contains
    procedure :: look_up
  end type lengths_t

contains

  !> Turn to a length; whether it is a new one, of which nothing is known.
  pure subroutine look_up(self, h, is_new)
    class(lengths_t), intent(inout) :: self
    real(wp), intent(in) :: h             !! the length
    logical, intent(out) :: is_new
    integer :: i
    is_new = .false.
    if (self%h(self%at) == h) return
    do i = 1, size(self%h)
      if (self%h(i) == h) then
        self%at = i
        return
      end if
    end do
    is_new = .true.
    self%at = self%oldest
    self%h(self%at) = h
    self%oldest = 1 + modulo(self%oldest, size(self%h))
  end subroutine look_up

  !> Change over a step by the four classical rates, about the first: where the rate is constant it
  !> is exact, and no rounding of weights adds up over many steps. The last rate enters last, in one
  !> product and one sum: nothing else waits for it.
  pure elemental real(wp) function change(h, k1, k2, k3, k4)
    real(wp), intent(in) :: h                !! step
    real(wp), intent(in) :: k1, k2, k3, k4   !! rates at begin, twice in the middle, at the end
    change = (h*k1 + (h*third)*((k2 - k1) + (k3 - k1))) + (h*sixth)*(k4 - k1)
  end function change
end module lapwing_system_step
