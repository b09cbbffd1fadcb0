!> Exclusion tests: bounds that rule an event out for a few operations. A step in contact that stays
!> inside its flank, a flight over pieces of a table on which it certainly meets no flank.
module lapwing_system_exclusion
  use lapwing_kinds, only: wp
  use lapwing_codes, only: drive_flank, coast_flank
  use lapwing_flank, only: flank_t
  use lapwing_polynomial_evaluation, only: max_degree, horner, value_and_slope, jet, &
      never_below
  use lapwing_system, only: frame_t, motion_t
  use lapwing_system_frames, only: move_to
  implicit none
  private
  public :: stays_inside, no_sooner, skip_ahead_in_flight, bound_depth_in_flight

  !> Bounds are lowered by far more than the rounding of a root or of a depth.
  real(wp), parameter :: caution = 1 - 2.0_wp**(-20), less = 1 - 2.0_wp**(-30)

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

  !> What spares a search for the largest distance from the drive flank: at the beginning of a
  !> flight a distance that it certainly exceeds, later how long it certainly stays below one.
  pure subroutine bound_depth_in_flight(path, width, force, motion, length, frame, floor, until)
    class(flank_t), intent(in) :: path           !! motion of the flanks
    real(wp), intent(in) :: width                !! distance between them, rad
    real(wp), intent(in) :: force                !! acceleration of the flight
    type(motion_t), intent(in) :: motion         !! step as a polynomial
    real(wp), intent(in) :: length               !! how much of it counts
    type(frame_t), intent(in) :: frame           !! frame, at the beginning of a piece
    real(wp), intent(inout) :: floor             !! distance, raised where the frame is as opened
    real(wp), intent(out) :: until               !! time up to which it is not exceeded
    integer, parameter :: samples = 7, refined = 3
    real(wp) :: s, best, depth, rate, bend
    integer :: i
    if (frame%piece_begin > 0) then
      call depth_at(path, width, frame, motion, frame%piece_begin, depth, rate, bend)
      until = frame%piece_begin + caution*no_sooner(floor - depth, rate, &
          path%push(drive_flank) - force)
      return
    end if
    until = 0
    best = 0
    do i = 1, samples
      call depth_at(path, width, frame, motion, i*length/(samples + 1), depth, rate, bend)
      if (less*depth > floor) best = i*length/(samples + 1)
      floor = max(floor, less*depth)
    end do
    if (.not. best > 0) return
    s = best
    do i = 1, refined
      call depth_at(path, width, frame, motion, s, depth, rate, bend)
      floor = max(floor, less*depth)
      if (bend >= force) return
      s = min(max(s - rate/(bend - force), 0.0_wp), length)
    end do
  end subroutine bound_depth_in_flight

  !> Distance from the drive flank in flight, its slope, and how the flank bends.
  pure subroutine depth_at(path, width, frame, motion, s, depth, rate, bend)
    class(flank_t), intent(in) :: path           !! motion of the flanks
    real(wp), intent(in) :: width                !! distance between them, rad
    type(frame_t), intent(in) :: frame           !! frame, on a piece that begins before s
    type(motion_t), intent(in) :: motion         !! step as a polynomial
    real(wp), intent(in) :: s                    !! time since the frame was opened
    real(wp), intent(out) :: depth, rate, bend   !! distance, its slope, second derivative of g
    type(frame_t) :: here
    here = frame
    call move_to(path, width, s, here)
    call jet(max_degree, here%flank(:, drive_flank), s - here%piece_begin, depth, rate, bend)
    depth = depth - horner(motion%dense(:, 1), s/motion%h)
    rate = rate - horner(motion%dense(:, 2), s/motion%h)
    bend = 2*bend
  end subroutine depth_at
end module lapwing_system_exclusion
