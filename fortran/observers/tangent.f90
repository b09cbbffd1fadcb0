!> The tangent map: what becomes of a small deviation of the state, cycle by cycle.
!>
!> A deviation (delta phi, delta phi') is taken at a fixed time. It is the same in theta as in phi,
!> so neither the chart nor a kink or knot matters. Between events it obeys the free equation of
!> the motion state; an event that the deviation moves in time multiplies it by a saltation matrix.
!> With x the distance pressed into the flank struck, v = x' before and w after, a the pressing
!> acceleration x'' without contact force, the event comes delta t = -delta x/v later and
!>     impact, relative velocities:   [w/v, 0; (1 + eps) a/v, -eps]
!>     impact, absolute velocities:   [w/v, 0; (1 + eps) F/v, -eps], F the force towards the flank
!>     engage, release:               [1, 0; -2 xi, 1] and [1, 0; 2 xi, 1].
!> Of further states, which no event changes, only the rates jump; each then has x' = v's part in
!> its rate in the first column, times (w - v)/v at an impact.
!> Leine and Nijmeijer, Dynamics and Bifurcations of Non-Smooth Mechanical Systems, 2004, ch. 7.
!>
!> The end of a complete chatter leaves one number of the two: when it comes. See `chatter_matrix`.
!> A tooth that rests on a rigid flank has forgotten both.
module lapwing_observers_tangent
  use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_negative_inf
  use lapwing_kinds, only: wp
  use lapwing_codes, only: separation, drive_flank, event_impact, event_release, event_engage, &
      event_chatter_end
  use lapwing_hybrid_state, only: segment_t, event_t
  use lapwing_observers_deviations, only: deviations_t, move_deviations, change_tooth
  use lapwing_polynomial_evaluation, only: max_degree, horner
  use lapwing_system, only: system_t, instant_t, frame_t, max_states
  implicit none
  private
  public :: tangent_t, tangent_columns, carry_along, jump, tangent_row
  public :: impact_matrix, chatter_matrix

  !> Columns of a line beside the matrix, and in all for the tooth alone: see `tangent_row`.
  integer, parameter :: rest_columns = 9, tangent_columns = 2**2 + rest_columns
  !> The matrix is scaled, exactly, when it leaves 2**-256 .. 2**256: far from under- and overflow
  !> also after one more factor.
  integer, parameter :: most_exponent = 256
  real(wp), parameter :: unit_matrix(max_states, max_states) = reshape([1.0_wp], &
      [max_states, max_states], pad=[spread(0.0_wp, 1, max_states), 1.0_wp])
  !> Contact that one matrix stands for, in decay times: exp(-128) at its smallest.
  real(wp), parameter :: most_decay = 64

  !> The map since the cycle began, m*2**exponent, and what its determinant must be.
  type :: tangent_t
    real(wp) :: m(max_states, max_states) = unit_matrix   !! matrix of the states in use
    integer :: exponent = 0                               !! of its scale
    real(wp) :: log_det = 0                               !! sum of ln|det| of the factors
    integer :: det_sign = 1                               !! sign of their product
    integer :: lost = 0                                   !! most numbers that a factor loses
    real(wp) :: contact_time(2) = 0                       !! in tau, by flank
    real(wp) :: pending = 0                               !! time in contact not yet in m
    integer :: impacts = 0                                !! impacts
    real(wp) :: log_rebound = 0                           !! sum of ln|w/v|
    real(wp) :: graze_depth = huge(1.0_wp)                !! least v**2/(2|a|) where a < 0, rad
  end type tangent_t

contains

  !> The line of a cycle: matrix by rows, exponent, ln|det|, its sign, rank, time on either flank,
  !> impacts, their sum of ln|w/v|, and how far the shallowest graze would have gone.
  pure function tangent_row(self, n) result(row)
    type(tangent_t), intent(in) :: self
    integer, intent(in) :: n                     !! states in use
    real(wp) :: row(n**2 + rest_columns)
    row(:n**2) = reshape(transpose(self%m(:n, :n)), [n**2])
    associate (rest => row(n**2 + 1:))
      rest = [real(self%exponent, wp), self%log_det, real([self%det_sign, n - self%lost], wp), &
          self%contact_time, real(self%impacts, wp), self%log_rebound, self%graze_depth]
      if (self%lost > 0) rest(2:3) = [ieee_value(rest(2), ieee_negative_inf), 0.0_wp]
    end associate
  end function tangent_row

  !> Carry a deviation along the arc of a segment, or to the end of a summed chatter.
  subroutine carry_along(self, system, deviations, segment)
    type(tangent_t), intent(inout) :: self
    class(system_t), intent(in) :: system        !! what moves
    type(deviations_t), intent(in) :: deviations !! how a deviation moves
    type(segment_t), intent(in) :: segment       !! what happened
    if (segment%begin%motion_state /= separation) then
      associate (time => self%contact_time(segment%begin%motion_state))
        time = time + segment%length
      end associate
      if (system%law%is_rigid()) then
        call forget(self, 0)
      else
        ! Once a contact: the steps of one are the same to the bit, and so would be their rounding.
        self%pending = self%pending + segment%length
        associate (divergence => deviations%divergence(segment%begin%motion_state))
          if (segment%n_events == 0 .and. .not. segment%cycle_completed &
              .and. -0.5_wp*divergence*self%pending < most_decay) return
          self%log_det = self%log_det + divergence*self%pending
        end associate
        call move(self, deviations, segment%begin%motion_state, self%pending)
        self%pending = 0
      end if
    else if (sums_chatter(segment)) then
      call end_chatter_summed(self, system, deviations, segment)
    else
      self%log_det = self%log_det + deviations%divergence(separation)*segment%length
      call move(self, deviations, separation, segment%length)
    end if
  end subroutine carry_along

  !> Along a smooth motion.
  subroutine move(self, deviations, motion_state, s)
    type(tangent_t), intent(inout) :: self
    type(deviations_t), intent(in) :: deviations !! how a deviation moves
    integer, intent(in) :: motion_state          !! motion state
    real(wp), intent(in) :: s                    !! for so long
    call move_deviations(deviations, motion_state, s, self%m)
    call keep_in_range(self, deviations%n)
  end subroutine move

  !> Whether a segment is the rest of a chatter: it ends with the chatter, and with no impact.
  pure logical function sums_chatter(segment)
    type(segment_t), intent(in) :: segment       !! what happened
    sums_chatter = .false.
    if (segment%n_events == 0) return
    sums_chatter = kind_at_drive(segment%events(1)) == event_chatter_end
  end function sums_chatter

  !> A chatter summed from the beginning of the segment, just after an impact. Further states go on
  !> as in contact; that they move over its short rest does not change when it ends.
  subroutine end_chatter_summed(self, system, deviations, segment)
    type(tangent_t), intent(inout) :: self
    class(system_t), intent(in) :: system        !! what moves
    type(deviations_t), intent(in) :: deviations !! how a deviation moves
    type(segment_t), intent(in) :: segment       !! what happened
    type(frame_t) :: frame
    real(wp) :: pressing(0:max_degree), distance, approach, tooth(2, max_states)
    integer :: flank
    flank = flank_of(segment%events(1))
    call system%open_frame(segment%begin, frame)
    call system%contact(frame, flank, 0.0_wp, segment%begin%y, distance, approach)
    call system%pressing(frame, flank, 0.0_wp, segment%begin%y, pressing)
    call forget(self, merge(0, 1, system%law%is_rigid()))
    tooth = self%m(:2, :)
    call move(self, deviations, flank, segment%length)
    self%m(:2, :) = tooth
    call change_tooth(chatter_matrix(pressing, -approach, system%law%restitution, segment%length), &
        deviations%n, self%m)
    call keep_in_range(self, deviations%n)
  end subroutine end_chatter_summed

  !> The events that a segment ends with.
  subroutine jump(self, system, deviations, segment, after)
    type(tangent_t), intent(inout) :: self
    class(system_t), intent(in) :: system        !! what moves
    type(deviations_t), intent(in) :: deviations !! how a deviation moves
    type(segment_t), intent(in) :: segment       !! what happened
    type(instant_t), intent(in) :: after         !! where the system is after them
    integer :: i, last
    last = 0
    do i = 1, segment%n_events
      select case (kind_at_drive(segment%events(i)))
      case (event_impact)
        call jump_at_impact(self, system, deviations, segment%events(i), after)
        last = i
      case (event_engage)
        if (system%law%is_rigid()) call forget(self, 0)
        call touch(self, deviations, flank_of(segment%events(i)), 1.0_wp)
      case (event_release)
        call touch(self, deviations, flank_of(segment%events(i)), -1.0_wp)
      case (event_chatter_end)
        if (last > 0) call end_chatter_at_impact(self, system, deviations, &
            segment%events(last), after)
      case default
        ! A kink leaves a deviation as it is.
      end select
    end do
  end subroutine jump

  !> Contact begins (sign 1) or ends (-1): the damper's force, and whatever else goes with the
  !> velocity in contact only, is there the earlier, the deeper the tooth is.
  pure subroutine touch(self, deviations, flank, sign)
    type(tangent_t), intent(inout) :: self
    type(deviations_t), intent(in) :: deviations !! how a deviation moves
    integer, intent(in) :: flank                 !! flank
    real(wp), intent(in) :: sign                 !! 1 or -1
    integer :: i
    associate (a => deviations%a)
      do i = 2, deviations%n
        self%m(i, :) = self%m(i, :) + sign*(a(i, 2, flank) - a(i, 2, separation))*self%m(1, :)
      end do
    end associate
  end subroutine touch

  !> An impact. One that the flank, drawing away faster and faster, almost missed is a graze.
  subroutine jump_at_impact(self, system, deviations, event, instant)
    type(tangent_t), intent(inout) :: self
    class(system_t), intent(in) :: system        !! what moves
    type(deviations_t), intent(in) :: deviations !! how a deviation moves
    type(event_t), intent(in) :: event           !! the impact
    type(instant_t), intent(in) :: instant       !! where the system is after it
    real(wp) :: pressing(0:max_degree), push, s(2, 2)
    integer :: i
    self%impacts = self%impacts + 1
    call accelerations(system, event, instant, pressing, push)
    if (pressing(0) < 0) then
      self%graze_depth = min(self%graze_depth, -0.5_wp*event%before**2/pressing(0))
    end if
    ! A tooth that arrives with no speed at all has no linear map; the graze is counted.
    if (event%before == 0) return
    if (system%law%sums_chatter(system%moves(flank_of(event)))) push = pressing(0)
    s = impact_matrix(abs(event%before), event%after*sign(1.0_wp, event%before), &
        system%law%restitution, push)
    if (s(1, 1) == 0 .or. s(2, 2) == 0) then
      call forget(self, 1)
    else
      self%log_rebound = self%log_rebound + log(abs(s(1, 1)))
      self%log_det = self%log_det + log(abs(s(1, 1)*s(2, 2)))
      if (s(1, 1)*s(2, 2) < 0) self%det_sign = -self%det_sign
    end if
    do i = 3, deviations%n
      self%m(i, :) = self%m(i, :) + deviations%a(i, 2, separation) &
          *((event%after - event%before)/event%before)*self%m(1, :)
    end do
    call change_tooth(s, deviations%n, self%m)
    call keep_in_range(self, deviations%n)
  end subroutine jump_at_impact

  !> Saltation matrix of an impact: in x and x', positive into the flank struck.
  pure function impact_matrix(before, after, restitution, push) result(s)
    real(wp), intent(in) :: before       !! v > 0, velocity into the flank
    real(wp), intent(in) :: after        !! w, the same after the impact, negative: rebounds
    real(wp), intent(in) :: restitution  !! eps
    real(wp), intent(in) :: push         !! a (relative velocities) or F (absolute)
    real(wp) :: s(2, 2)
    s(1, :) = [after/before, 0.0_wp]
    s(2, :) = [(1 + restitution)*push/before, -restitution]
  end function impact_matrix

  !> What a deviation just after an impact makes of the chatter's end.
  !>
  !> The tooth leaves with speed u and x'' = a + j s + ... The deviation moves the impact before by
  !> delta t0 = delta x/u and the speed by delta u = -delta x' - a delta t0; so the end, T(u, t) =
  !> 2u/(a(1 - eps)) - 4j u**2/(3a**3(1 - eps)**2) later, comes by
  !>     delta t = (1 + dT/dt - a dT/du) delta x/u - dT/du delta x'
  !> later. From there x'' = a in contact: (delta x, delta x') = (0, -a delta t).
  pure function chatter_matrix(pressing, speed, restitution, duration) result(s)
    real(wp), intent(in) :: pressing(0:max_degree)  !! a, j, ... about the impact
    real(wp), intent(in) :: speed                   !! u > 0, separation speed after it
    real(wp), intent(in) :: restitution             !! eps
    real(wp), intent(in) :: duration                !! T, 0: there is no sum, the end is the impact
    real(wp) :: s(2, 2), a, j, loss, by_speed, by_time
    a = pressing(0)
    j = pressing(1)
    loss = 1 - restitution
    by_speed = 0
    by_time = 0
    if (duration > 0) then
      by_speed = 2/(a*loss) - 8*j*speed/(3*a**3*loss**2)
      by_time = -2*j*speed/(a**2*loss)
    end if
    s(1, :) = 0
    s(2, :) = -horner(pressing, duration)*[(1 + by_time - a*by_speed)/speed, -by_speed]
  end function chatter_matrix

  !> A chatter whose last impact leaves less than time can resolve. With absolute velocities and
  !> a moving flank the bounces have no sum: the end is the impact.
  subroutine end_chatter_at_impact(self, system, deviations, impact, instant)
    type(tangent_t), intent(inout) :: self
    class(system_t), intent(in) :: system        !! what moves
    type(deviations_t), intent(in) :: deviations !! how a deviation moves
    type(event_t), intent(in) :: impact          !! the last impact
    type(instant_t), intent(in) :: instant       !! where the system is after it
    real(wp) :: pressing(0:max_degree), push, rest, speed
    call accelerations(system, impact, instant, pressing, push)
    speed = abs(impact%after)
    rest = 0
    if (system%law%sums_chatter(system%moves(flank_of(impact)))) then
      rest = 2*speed/(pressing(0)*(1 - system%law%restitution))
    end if
    call forget(self, merge(0, 1, system%law%is_rigid()))
    call change_tooth(chatter_matrix(pressing, speed, system%law%restitution, rest), deviations%n, &
        self%m)
    call keep_in_range(self, deviations%n)
  end subroutine end_chatter_at_impact

  !> At an event: pressing acceleration of its flank, and the force towards it.
  subroutine accelerations(system, event, after, pressing, push)
    class(system_t), intent(in) :: system             !! what moves
    type(event_t), intent(in) :: event                !! event at a flank
    type(instant_t), intent(in) :: after              !! where the system is after it
    real(wp), intent(out) :: pressing(0:max_degree)   !! Taylor coefficients about it
    real(wp), intent(out) :: push                     !! acceleration in flight
    type(instant_t) :: instant
    type(frame_t) :: frame
    real(wp) :: rate(max_states)
    instant%motion_state = separation
    instant%chart = flank_of(event)
    instant%cycle = event%cycle
    instant%t = event%t
    instant%y = after%y
    call system%place_at_flank(instant%chart, 0.0_wp, instant%y)
    call system%open_frame(instant, frame)
    call system%pressing(frame, instant%chart, 0.0_wp, instant%y, pressing)
    rate = 0
    call system%derivatives(frame, separation, 0.0_wp, instant%y(:system%n_states), &
        rate(:system%n_states))
    push = merge(rate(2), -rate(2), instant%chart == drive_flank)
  end subroutine accelerations

  !> Scale the matrix, exactly, where its numbers become very large or small.
  pure subroutine keep_in_range(self, n)
    type(tangent_t), intent(inout) :: self
    integer, intent(in) :: n                     !! states in use
    real(wp) :: largest
    integer :: shift
    largest = maxval(abs(self%m(:n, :n)))
    if (.not. largest > 0) return
    shift = exponent(largest)
    if (abs(shift) <= most_exponent) return
    self%m(:n, :n) = scale(self%m(:n, :n), -shift)
    self%exponent = self%exponent + shift
  end subroutine keep_in_range

  !> Some of the tooth's deviation is lost for good: from here on at most so many of its two numbers
  !> are left.
  pure subroutine forget(self, left)
    type(tangent_t), intent(inout) :: self
    integer, intent(in) :: left                  !! numbers left, 0 or 1
    self%lost = max(self%lost, 2 - left)
    if (left == 0) self%m(:2, :) = 0
  end subroutine forget

  pure integer function flank_of(event)
    type(event_t), intent(in) :: event           !! event at a flank
    flank_of = drive_flank + modulo(event%kind - event_impact, 2)
  end function flank_of

  !> Kind of an event, as it is called at the drive flank.
  pure integer function kind_at_drive(event)
    type(event_t), intent(in) :: event           !! event
    kind_at_drive = event%kind - modulo(event%kind - event_impact, 2)
  end function kind_at_drive
end module lapwing_observers_tangent
