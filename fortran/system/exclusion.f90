!> Exclusion tests: bounds that rule an event out for a few operations. A step in contact that stays
!> inside its flank, a flight over pieces of a table on which it certainly meets no flank.
module lapwing_system_exclusion
  use lapwing_kinds, only: wp
  use lapwing_codes, only: drive_flank, coast_flank
  use lapwing_flank, only: flank_t
  use lapwing_polynomial_evaluation, only: horner, value_and_slope, never_below
  use lapwing_system, only: frame_t, motion_t
  use lapwing_system_frames, only: move_to
  implicit none
  private
  public :: stays_inside, no_sooner, skip_ahead_in_flight

contains

  !> Whether a step in contact certainly stays inside its flank, whose largest acceleration of all
  !> pieces moves it outwards by push s**2/2.
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
    real(wp), intent(in) :: distance
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

  !> Up to the piece on which a flank might be met: from bound to bound, until one ends on the piece
  !> where it began.
  pure subroutine skip_ahead_in_flight(path, width, n_flanks, force, motion, frame, touching, clear)
    class(flank_t), intent(in) :: path           !! motion of the flanks
    real(wp), intent(in) :: width                !! distance between them, rad
    integer, intent(in) :: n_flanks              !! 2, or 1 without a coast flank
    real(wp), intent(in) :: force                !! acceleration of the flight
    type(motion_t), intent(in) :: motion         !! step as a polynomial
    type(frame_t), intent(inout) :: frame        !! frame, on the piece to be searched next
    integer, intent(inout) :: touching           !! flank at zero distance where it begins, or none
    logical, intent(out) :: clear                !! whether nothing is met up to the step's end
    real(wp) :: s
    s = frame%piece_begin
    do
      s = s + safe_time(path, width, n_flanks, force, frame, touching, motion, s)
      clear = s >= motion%h
      if (.not. clear .and. s <= frame%piece_end) return
      call move_to(path, width, min(s, motion%h), frame)
      if (clear) return
      touching = 0
    end do
  end subroutine skip_ahead_in_flight

  !> Time for which a flight, at s of a step, can meet no flank: the distance begins with the value
  !> and slope it has there and bends towards the flank with the largest acceleration of all pieces.
  pure real(wp) function safe_time(path, width, n_flanks, force, frame, touching, motion, s)
    class(flank_t), intent(in) :: path           !! motion of the flanks
    real(wp), intent(in) :: width                !! distance between them, rad
    integer, intent(in) :: n_flanks              !! 2, or 1 without a coast flank
    real(wp), intent(in) :: force                !! acceleration of the flight
    type(frame_t), intent(in) :: frame           !! frame, on the piece that holds s
    integer, intent(in) :: touching              !! flank at zero distance there, or none
    type(motion_t), intent(in) :: motion         !! step as a polynomial
    real(wp), intent(in) :: s                    !! time since the frame was opened
    real(wp), parameter :: caution = 1 - 2.0_wp**(-20)   !! far more than the rounding of a root
    real(wp) :: position, slope, above, below, approach
    call value_and_slope(frame%flank(:, frame%chart), s - frame%piece_begin, position, slope)
    ! Distances to the coast flank, and to the drive flank.
    below = horner(motion%dense(:, 1), s/motion%h) - position
    approach = horner(motion%dense(:, 2), s/motion%h) - slope
    if (frame%chart == drive_flank) then
      above = -below
      below = below + width
    else
      above = width - below
    end if
    if (touching == drive_flank) above = 0
    if (touching == coast_flank) below = 0
    safe_time = no_sooner(above, approach, force + path%push(coast_flank))
    if (n_flanks == 2) then
      safe_time = min(safe_time, no_sooner(below, -approach, &
          path%push(drive_flank) - force))
    end if
    safe_time = caution*safe_time
  end function safe_time
end module lapwing_system_exclusion
