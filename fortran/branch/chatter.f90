!> Bounces that die out, one by one until what is left can be summed.
module lapwing_branch_chatter
  use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
  use lapwing_kinds, only: wp
  use lapwing_branch_curve, only: curve_t, piece_at, derivatives, rise
  implicit none
  private
  public :: ball_t, chatter_rest, bounces_of

  !> What bounces.
  type :: ball_t
    real(wp) :: force = 0              !! F, rad
    real(wp) :: restitution = 0        !! of each impact
    real(wp) :: gap = 0                !! distance of the flanks, rad
    logical :: back_moves = .true.     !! whether the coast flank does
  end type ball_t

  !> One bounce.
  type :: bounce_t
    real(wp) :: s = 0, arrival = 0     !! its length and the speed at its end
    real(wp) :: press = 0, press_end = 0   !! accelerations into the flank at both ends
  end type bounce_t

  integer, parameter :: most_bounces = 100000, most_corrections = 60
  !> Part of the mesh period that the sum may neglect.
  real(wp), parameter :: neglected = 1e-13_wp
  !> A bounce slower than this part of F P is summed whatever lies in it: it lasts 1e-14 periods, or
  !> 3e-7 where the tooth is pressed no longer at its end, beyond which the equations go on.
  real(wp), parameter :: no_speed = 1e-15_wp

contains

  !> How long bounces go on after one that leaves with some speed, and the derivatives of that by
  !> speed and by the time of the bounce; not a number where they do not die out.
  subroutine chatter_rest(curve, ball, flank, phase, piece, speed, length, by_speed, by_time)
    type(curve_t), intent(in) :: curve     !! flank
    type(ball_t), intent(in) :: ball       !! what bounces
    integer, intent(in) :: flank           !! where, 1 or 2
    real(wp), intent(in) :: phase          !! mesh periods, of the bounce
    integer, intent(in) :: piece           !! its piece
    real(wp), intent(in) :: speed          !! off the flank, rad per tau
    real(wp), intent(out) :: length        !! tau
    real(wp), intent(out) :: by_speed, by_time   !! derivatives
    real(wp) :: t, u, dt(2), du(2), rest(3), way(2)
    type(bounce_t) :: one
    integer :: at, k
    t = 0
    u = speed
    dt = [1, 0]     ! by the time of the first bounce and by its speed
    du = [0, 1]
    at = piece
    do k = 1, most_bounces
      if (is_summed(curve, ball, flank, phase + t/curve%period, at, u, rest)) then
        length = t + rest(1)
        way = dt + rest(2)*du + rest(3)*dt
        by_time = way(1) - 1
        by_speed = way(2)
        return
      end if
      one = next_bounce(curve, ball, flank, phase + t/curve%period, at, u)
      if (.not. one%arrival > 0) exit
      ! X(t, u, s) = 0 at the end of the flight, with dX/ds = arrival.
      way = (-(one%arrival + u - one%press*one%s)*dt + one%s*du)/one%arrival
      du = ball%restitution*(-du + (one%press_end - one%press)*dt + one%press_end*way)
      dt = dt + way
      t = t + one%s
      u = ball%restitution*one%arrival
      at = piece_at(curve, phase + t/curve%period)
    end do
    length = ieee_value(length, ieee_quiet_nan)
    by_speed = length
    by_time = length
  end subroutine chatter_rest

  !> Phases and speeds into the flank of the bounces after one, until they are too small to tell.
  subroutine bounces_of(curve, ball, flank, phase, piece, speed, phases, speeds, count)
    type(curve_t), intent(in) :: curve     !! flank
    type(ball_t), intent(in) :: ball       !! what bounces
    integer, intent(in) :: flank           !! where, 1 or 2
    real(wp), intent(in) :: phase          !! mesh periods, of the bounce before
    integer, intent(in) :: piece           !! its piece
    real(wp), intent(in) :: speed          !! off the flank, rad per tau
    real(wp), intent(inout) :: phases(:), speeds(:)   !! room for them
    integer, intent(out) :: count          !! how many
    real(wp) :: u, here
    type(bounce_t) :: one
    integer :: at
    count = 0
    here = phase
    u = speed
    at = piece
    do while (count < min(size(phases), size(speeds)))
      if (u <= no_speed*abs(ball%force)*curve%period) exit
      one = next_bounce(curve, ball, flank, here, at, u)
      if (.not. one%arrival > 0) exit
      here = here + one%s/curve%period
      u = ball%restitution*one%arrival
      at = piece_at(curve, here)
      count = count + 1
      phases(count) = here
      speeds(count) = one%arrival
    end do
  end subroutine bounces_of

  !> Whether the bounces from here on can be summed, and if so how long they go on and the
  !> derivatives of that by speed and time.
  logical function is_summed(curve, ball, flank, phase, piece, u, rest) result(yes)
    type(curve_t), intent(in) :: curve     !! flank
    type(ball_t), intent(in) :: ball       !! what bounces
    integer, intent(in) :: flank, piece    !! where
    real(wp), intent(in) :: phase, u       !! mesh periods; speed off the flank
    real(wp), intent(out) :: rest(3)       !! length and its derivatives
    real(wp) :: d(0:5), sign, press, jerk, loss, ratio, left
    sign = merge(1.0_wp, -1.0_wp, flank == 1)
    d = 0
    if (flank == 1 .or. ball%back_moves) d = derivatives(curve, phase, piece)
    loss = 1 - ball%restitution
    press = sign*(ball%force - d(2))
    jerk = -sign*d(3)
    rest = 0
    yes = .false.
    if (.not. (press > 0 .and. loss > 0)) return
    left = 2*u/(press*loss)
    ratio = 2*abs(jerk)*u/(3*press**2*loss)
    if (u > no_speed*abs(ball%force)*curve%period) then
      if (left*(ratio**2 + abs(d(4))*u**2/(press**3*loss**2)) > neglected*curve%period) return
      if (curve%pieces > 0 .and. (flank == 1 .or. ball%back_moves)) then
        if (piece_at(curve, phase + left/curve%period) /= piece) return
      end if
    end if
    rest = [left - 4*jerk*u**2/(3*press**3*loss**2), &
        2/(press*loss) - 8*jerk*u/(3*press**3*loss**2), -2*u*jerk/(press**2*loss)]
    yes = .true.
  end function is_summed

  !> The flight after a bounce along a flank whose pieces it may cross.
  type(bounce_t) function next_bounce(curve, ball, flank, phase, piece, u) result(one)
    type(curve_t), intent(in) :: curve     !! flank
    type(ball_t), intent(in) :: ball       !! what bounces
    integer, intent(in) :: flank, piece    !! where
    real(wp), intent(in) :: phase, u       !! mesh periods; speed off the flank
    real(wp) :: sign, known(0:5), there(0:5), lean, step, last
    logical :: moves
    integer :: k, at
    sign = merge(1.0_wp, -1.0_wp, flank == 1)
    moves = flank == 1 .or. ball%back_moves
    known = 0
    if (moves) known = derivatives(curve, phase, piece)
    one%press = sign*(ball%force - known(2))
    if (.not. one%press > 0) return
    one%s = 2*u/one%press
    ! A bounce that lasts longer is none that dies out.
    if (.not. one%s < curve%period) return
    last = huge(last)
    do k = 1, most_corrections
      there = 0
      lean = -u + sign*0.5_wp*ball%force*one%s
      if (moves) then
        lean = lean - sign*rise(curve, phase, piece, known, one%s, .true.)
        at = piece_at(curve, phase + one%s/curve%period)
        there = derivatives(curve, phase + one%s/curve%period, at)
      end if
      one%arrival = -u + sign*(ball%force*one%s - (there(1) - known(1)))
      step = -lean*one%s/(one%arrival - lean)
      if (abs(step) >= last .and. last < 1e-8_wp*one%s) exit
      one%s = one%s + step
      last = abs(step)
      if (.not. (one%s > 0 .and. one%s < curve%period)) exit
      if (last < 1e-16_wp*one%s) exit
    end do
    one%press_end = sign*(ball%force - there(2))
    if (.not. (one%s > 0 .and. one%s < curve%period .and. last < 1e-8_wp*one%s)) one%arrival = 0
  end function next_bounce

end module lapwing_branch_chatter
