!> Exclusion tests: bounds that rule an event out for a few operations. A step in contact that stays
!> inside its flank, a flight over pieces of a table on which it certainly meets no flank.
module lapwing_system_exclusion
  use lapwing_kinds, only: wp
  use lapwing_codes, only: separation, drive_flank, coast_flank
  use lapwing_flank, only: flank_t
  use lapwing_polynomial_evaluation, only: max_degree, horner, value_and_slope, jet, &
      never_below
  use lapwing_system, only: frame_t, motion_t
  use lapwing_system_frames, only: move_to
  implicit none
  private
  public :: stays_inside, no_sooner, skip_ahead_on_arc, bound_depth_in_flight

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
    inward = inwards(flank)
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

  !> Up to the piece on which a flank might be met, or left: from bound to bound, until one ends on
  !> the piece where it began.
  pure subroutine skip_ahead_on_arc(path, width, n_flanks, motion_state, force, motion, frame, &
      touching, clear)
    class(flank_t), intent(in) :: path           !! motion of the flanks
    real(wp), intent(in) :: width                !! distance between them, rad
    integer, intent(in) :: n_flanks              !! 2, or 1 without a coast flank
    integer, intent(in) :: motion_state
    real(wp), intent(in) :: force                !! acceleration of a flight
    type(motion_t), intent(in) :: motion         !! step as a polynomial
    type(frame_t), intent(inout) :: frame        !! frame, on the piece to be searched next
    integer, intent(inout) :: touching           !! flank at zero distance where it begins, or none
    logical, intent(out) :: clear                !! whether nothing is met up to the step's end
    real(wp) :: s, safe, pull(2)
    if (motion_state == separation) then
      pull = [force + path%push(coast_flank), path%push(drive_flank) - force]
    else
      pull(motion_state) = path%push(motion_state) - least_acceleration(motion_state, motion)
    end if
    s = frame%piece_begin
    do
      if (motion_state == separation) then
        safe = safe_flight(width, n_flanks, pull, frame, touching, motion, s)
      else
        safe = safe_contact(motion_state, pull(motion_state), frame, touching, motion, s)
      end if
      s = s + caution*safe
      clear = s >= motion%h
      if (.not. clear .and. s <= frame%piece_end) return
      call move_to(path, width, min(s, motion%h), frame)
      if (clear) return
      touching = 0
    end do
  end subroutine skip_ahead_on_arc

  !> Time for which a flight, at s of a step, can meet no flank: the distance begins with the value
  !> and slope it has there and bends towards the flank with the largest acceleration of all pieces.
  pure real(wp) function safe_flight(width, n_flanks, pull, frame, touching, motion, s)
    real(wp), intent(in) :: width                !! distance between the flanks, rad
    integer, intent(in) :: n_flanks              !! 2, or 1 without a coast flank
    real(wp), intent(in) :: pull(2)              !! largest acceleration towards each
    type(frame_t), intent(in) :: frame           !! frame, on the piece that holds s
    integer, intent(in) :: touching              !! flank at zero distance there, or none
    type(motion_t), intent(in) :: motion         !! step as a polynomial
    real(wp), intent(in) :: s                    !! time since the frame was opened
    real(wp) :: above, below, rate
    ! Distances to the coast flank, and to the drive flank.
    call beyond_flank(frame, motion, s, below, rate)
    if (frame%chart == drive_flank) then
      above = -below
      below = below + width
    else
      above = width - below
    end if
    if (touching == drive_flank) above = 0
    if (touching == coast_flank) below = 0
    safe_flight = no_sooner(above, rate, pull(drive_flank))
    if (n_flanks == 2) safe_flight = min(safe_flight, no_sooner(below, -rate, pull(coast_flank)))
  end function safe_flight

  !> Time for which a contact, at s of a step, can not end: the same of the depth in the flank.
  pure real(wp) function safe_contact(flank, pull, frame, touching, motion, s)
    integer, intent(in) :: flank                 !! flank in contact, the frame's chart
    real(wp), intent(in) :: pull                 !! largest acceleration out of it
    type(frame_t), intent(in) :: frame           !! frame, on the piece that holds s
    integer, intent(in) :: touching              !! flank at zero distance there, or none
    type(motion_t), intent(in) :: motion         !! step as a polynomial
    real(wp), intent(in) :: s                    !! time since the frame was opened
    real(wp) :: depth, rate
    call beyond_flank(frame, motion, s, depth, rate)
    if (touching == flank) depth = 0
    safe_contact = no_sooner(inwards(flank)*depth, -inwards(flank)*rate, pull)
  end function safe_contact

  !> Position relative to the flank of a frame's chart, at s of a step, and its rate.
  pure subroutine beyond_flank(frame, motion, s, distance, rate)
    type(frame_t), intent(in) :: frame           !! frame, on the piece that holds s
    type(motion_t), intent(in) :: motion         !! step as a polynomial
    real(wp), intent(in) :: s                    !! time since the frame was opened
    real(wp), intent(out) :: distance, rate
    real(wp) :: position, slope
    call value_and_slope(frame%flank(:, frame%chart), s - frame%piece_begin, position, slope)
    distance = horner(motion%dense(:, 1), s/motion%h) - position
    rate = horner(motion%dense(:, 2), s/motion%h) - slope
  end subroutine beyond_flank

  !> Sign of a motion into a flank.
  pure real(wp) function inwards(flank)
    integer, intent(in) :: flank
    inwards = merge(1.0_wp, -1.0_wp, flank == drive_flank)
  end function inwards

  !> Lower bound, over a step, of the acceleration into a flank.
  pure real(wp) function least_acceleration(flank, motion)
    integer, intent(in) :: flank
    type(motion_t), intent(in) :: motion         !! step as a polynomial
    associate (c => inwards(flank)*motion%dense(:, 1))
      least_acceleration = never_below([2*c(3), 6*c(4), 12*c(5), 20*c(6), 0.0_wp, 0.0_wp]) &
          /motion%h**2
    end associate
  end function least_acceleration

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
