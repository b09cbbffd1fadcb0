!> The step rule: proportional-integral control of the local error.
!>
!> Gustafsson, Lundh and Soderlind, BIT 28 (1988) 270-287. The exponents are sixteenths, near the
!> usual 0.7/5 and 0.4/5, so that square roots make them: those are the same on every processor.
!> Each motion state keeps a memory of its own, so that a flight does not lengthen the first step
!> in contact, nor a contact shorten the next flight.
module lapwing_flow_rk4_step_control
  use lapwing_kinds, only: wp
  use lapwing_flow, only: step_memory_t
  implicit none
  private
  public :: step_to_try, error_ratio, after_accepted, after_rejected

  !> Share of the tolerance that one step may spend. A mesh period in contact takes hundreds of
  !> steps whose errors add up; with this share the error of an event time stays below
  !> `rtol` mesh periods, times what the dynamics make of it (tests/test_convergence.py).
  real(wp), parameter :: share_per_step = 1.0_wp/96
  real(wp), parameter :: safety = 0.9_wp
  real(wp), parameter :: most_growth = 5
  real(wp), parameter :: most_shrinkage = 0.1_wp
  !> Error ratios after which a step keeps its length: a new one would differ by 2 %, and the
  !> next step would have to wait for its roots. The rule tends to 0.9**16 = 0.185.
  real(wp), parameter :: low_enough = 0.25_wp, high_enough = 0.13_wp
  !> Keeps the integral term finite where a step was exact.
  real(wp), parameter :: least_ratio = 1.0e-4_wp

contains

  !> Step to try next. Where nothing is known a flight tries as far as it may go; a contact, in its
  !> own unit of time, tries what a spring mostly takes.
  pure real(wp) function step_to_try(memory, in_contact, tolerance)
    type(step_memory_t), intent(in) :: memory   !! memory of the motion state
    logical, intent(in) :: in_contact           !! whether that is a contact
    real(wp), intent(in) :: tolerance           !! relative tolerance of the run
    step_to_try = memory%step
    if (in_contact .and. .not. memory%step < huge(memory%step)) then
      step_to_try = 2*fourth_root(fourth_root(tolerance))**3
    end if
  end function step_to_try

  !> Largest estimated error in units of the tolerance.
  pure real(wp) function error_ratio(error, scale, tolerance)
    real(wp), intent(in) :: error(:)    !! estimated errors
    real(wp), intent(in) :: scale(:)    !! natural sizes
    real(wp), intent(in) :: tolerance   !! relative tolerance of the run
    if (size(error) == 2) then
      error_ratio = max(error(1)/scale(1), error(2)/scale(2))/(share_per_step*tolerance)
    else
      error_ratio = maxval(error/scale)/(share_per_step*tolerance)
    end if
  end function error_ratio

  !> Remember an accepted step. A step cut short by a stop never shortens the next one.
  pure subroutine after_accepted(memory, h, ratio, cut_short)
    type(step_memory_t), intent(inout) :: memory   !! memory of the motion state
    real(wp), intent(in) :: h                      !! step taken
    real(wp), intent(in) :: ratio                  !! its error ratio, at most 1
    logical, intent(in) :: cut_short               !! whether it was shorter than proposed
    real(wp) :: factor, bounded
    ! A flight may always go as far as it can.
    if (cut_short .and. .not. memory%step < huge(h)) return
    if (ratio >= high_enough .and. ratio <= low_enough .and. .not. cut_short) then
      memory%step = h
      memory%ratio = ratio
      return
    end if
    bounded = max(ratio, least_ratio)
    ! (before/now**2)**(1/16), one root of it taken while the step was still under way.
    factor = safety*sqrt(fourth_root(sqrt(memory%ratio)/bounded))
    factor = min(most_growth, max(most_shrinkage, factor))
    if (cut_short) then
      memory%step = max(memory%step, h*factor)
    else
      memory%step = h*factor
      memory%ratio = bounded
    end if
  end subroutine after_accepted

  !> Step to try after one whose error was too large: the estimate falls as h**5, the fourth root
  !> leaves a margin.
  pure real(wp) function after_rejected(h, ratio)
    real(wp), intent(in) :: h       !! step tried
    real(wp), intent(in) :: ratio   !! its error ratio, above 1
    after_rejected = h*max(most_shrinkage, safety/fourth_root(ratio))
  end function after_rejected

  pure real(wp) function fourth_root(x)
    real(wp), intent(in) :: x   !! not negative
    fourth_root = sqrt(sqrt(x))
  end function fourth_root
end module lapwing_flow_rk4_step_control
