!> The step rule: proportional-integral control of the local error.
!>
!> Gustafsson, Lundh and Soderlind, BIT 28 (1988) 270-287. The exponents are sixteenths, near the
!> usual 0.7/5 and 0.4/5. Lengths are rungs of a ladder, the powers of 2**(1/8): how many rungs the
!> rule goes is told by the exponent of a number, without a root, and the same few lengths come
!> again, so that what a step needs of its length is there already.
!> Each motion state keeps a memory of its own, so that a flight does not lengthen the first step
!> in contact, nor a contact shorten the next flight.
module lapwing_flow_rk4_step_control
  use lapwing_kinds, only: wp
  use lapwing_flow, only: step_memory_t
  implicit none
  private
  public :: step_to_try, allowed_error, error_ratio, after_accepted, after_rejected

  !> Share of the tolerance that one step may spend. A mesh period in contact takes hundreds of
  !> steps whose errors add up; with this share the error of an event time stays below
  !> `rtol` mesh periods, times what the dynamics make of it (tests/test_convergence.py).
  real(wp), parameter :: share_per_step = 1.0_wp/96
  real(wp), parameter :: safety = 0.9_wp
  !> Error ratio to which the rule tends: a factor of one there.
  real(wp), parameter :: steady = safety**16
  !> Rungs that a step may grow or shrink at once: less than 5 times, no less than a tenth.
  integer, parameter :: most_up = 18, most_down = 26
  real(wp), parameter :: most_shrinkage = 0.1_wp
  !> Keeps the integral term finite where a step was exact.
  real(wp), parameter :: least_ratio = 1.0e-4_wp
  !> The rungs from 1/2 to 1.
  integer, parameter :: per_octave = 8
  real(wp), parameter :: octave(0:per_octave - 1) = &
      0.5_wp*2.0_wp**([0, 1, 2, 3, 4, 5, 6, 7]/real(per_octave, wp))

contains

  !> Step to try next. Where nothing is known a flight tries as far as it may go; a contact, in its
  !> own unit of time, tries what a spring mostly takes.
  pure real(wp) function step_to_try(memory, in_contact, tolerance)
    type(step_memory_t), intent(in) :: memory   !! memory of the motion state
    logical, intent(in) :: in_contact           !! whether that is a contact
    real(wp), intent(in) :: tolerance           !! relative tolerance of the run
    step_to_try = memory%step
    if (in_contact .and. .not. memory%step < huge(memory%step)) then
      step_to_try = length_of(rung_below(2*fourth_root(fourth_root(tolerance))**3))
    end if
  end function step_to_try

  !> Error that one step may make of a coordinate.
  pure elemental real(wp) function allowed_error(scale, tolerance)
    real(wp), intent(in) :: scale       !! its natural size
    real(wp), intent(in) :: tolerance   !! relative tolerance of the run
    allowed_error = share_per_step*tolerance*scale
  end function allowed_error

  !> Largest estimated error in units of what is allowed.
  pure real(wp) function error_ratio(error, allowed)
    real(wp), intent(in) :: error(:)    !! estimated errors
    real(wp), intent(in) :: allowed(:)  !! what each may be
    integer :: i
    error_ratio = 0
    !GCC$ novector
    do i = 1, size(error)
      ! One that is not a number stays.
      if (error_ratio <= error(i)/allowed(i) .or. .not. error(i) <= huge(error)) then
        error_ratio = error(i)/allowed(i)
      end if
    end do
  end function error_ratio

  !> Remember an accepted step. A step cut short by a stop never shortens the next one.
  pure subroutine after_accepted(memory, h, ratio, cut_short)
    type(step_memory_t), intent(inout) :: memory   !! memory of the motion state
    real(wp), intent(in) :: h                      !! step taken, a rung unless cut short
    real(wp), intent(in) :: ratio                  !! its error ratio, at most 1
    logical, intent(in) :: cut_short               !! whether it was shorter than proposed
    real(wp) :: bounded, power
    ! A flight may always go as far as it can.
    if (cut_short .and. .not. memory%step < huge(h)) return
    bounded = max(ratio, least_ratio)
    ! The rule's factor, to the 16th: four to go a rung. The nearest rung: between a half and two
    ! the length stays.
    power = steady*memory%ratio/bounded**2
    if (cut_short) then
      memory%step = max(memory%step, length_of(rung_below(h) + rungs(power)))
      return
    end if
    memory%step = h
    if (power < 0.5_wp .or. power >= 2) memory%step = length_of(rung_below(h) + rungs(power))
    memory%ratio = bounded
  end subroutine after_accepted

  !> Step to try after one whose error was too large: the estimate falls as h**5, the fourth root
  !> leaves a margin.
  pure real(wp) function after_rejected(h, ratio)
    real(wp), intent(in) :: h       !! step tried
    real(wp), intent(in) :: ratio   !! its error ratio, above 1 or not a number
    real(wp) :: factor
    factor = most_shrinkage
    if (ratio <= huge(ratio)) factor = max(factor, safety/fourth_root(ratio))
    after_rejected = length_of(rung_below(h*factor))
  end function after_rejected

  !> Rungs to go for a factor whose 16th power this is: its logarithm to the base 2 over 16/8, to
  !> the nearest number.
  pure integer function rungs(power)
    real(wp), intent(in) :: power   !! positive
    rungs = max(-most_down, min(most_up, shifta(exponent(power), 1)))
  end function rungs

  !> Highest rung that is no longer than a step.
  pure integer function rung_below(h)
    real(wp), intent(in) :: h       !! positive
    rung_below = per_octave*exponent(h) + count(octave(1:) <= fraction(h))
  end function rung_below

  !> Length of a rung.
  pure real(wp) function length_of(rung)
    integer, intent(in) :: rung
    length_of = scale(octave(modulo(rung, per_octave)), shifta(rung, 3))
  end function length_of

  pure real(wp) function fourth_root(x)
    real(wp), intent(in) :: x   !! not negative
    fourth_root = sqrt(sqrt(x))
  end function fourth_root
end module lapwing_flow_rk4_step_control
