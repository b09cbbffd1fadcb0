!> Bounds that rule an event out for a few operations: a step in contact that stays inside its
!> flank, a flight that cannot be back yet.
module lapwing_system_clearance
  use lapwing_kinds, only: wp
  use lapwing_codes, only: drive_flank
  use lapwing_polynomial_evaluation, only: never_below
  use lapwing_system, only: motion_t
  implicit none
  private
  public :: stays_inside, no_sooner

contains

  !> Whether a step in contact certainly stays inside a flank that pushes as much as it can
  !> anywhere: by push s**2/2 in its own frame.
  pure logical function stays_inside(push, flank, touching, motion)
    real(wp), intent(in) :: push                 !! greatest acceleration of the flank outwards
    integer, intent(in) :: flank                 !! flank in contact
    integer, intent(in) :: touching              !! flank at zero distance at the beginning, or none
    type(motion_t), intent(in) :: motion         !! step as a polynomial
    real(wp) :: inward, least
    inward = merge(1.0_wp, -1.0_wp, flank == drive_flank)
    associate (c => motion%dense(:, 1))
      least = never_below([inward*c(2), inward*c(3) - 0.5_wp*motion%h**2*max(0.0_wp, push), &
          inward*c(4), inward*c(5), inward*c(6), 0.0_wp])
      if (touching /= flank) least = inward*c(1) + min(0.0_wp, least)
    end associate
    stays_inside = least > 0
  end function stays_inside

  !> Earliest time at which a distance with second derivative -pull or more can vanish.
  pure real(wp) function no_sooner(distance, approach, pull)
    real(wp), intent(in) :: distance   !! distance
    real(wp), intent(in) :: approach   !! minus its first derivative
    real(wp), intent(in) :: pull       !! minus its least second derivative
    real(wp) :: square
    no_sooner = 0
    if (distance < 0 .or. (.not. distance > 0 .and. approach >= 0)) return
    no_sooner = huge(distance)
    square = approach**2 + 2*pull*distance
    if (square < 0) return
    if (approach > 0) then
      no_sooner = 2*distance/(approach + sqrt(square))
    else if (pull > 0) then
      no_sooner = (sqrt(square) - approach)/pull
    end if
  end function no_sooner
end module lapwing_system_clearance
