!> A periodic motion as equations between its events: pydriver/lapwing/studies/branch/motion/
!> equations.py says which, and where the formulas come from.
module lapwing_branch_equations
  use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
  use lapwing_kinds, only: wp
  use lapwing_branch_curve, only: curve_t, derivatives, response, rise
  use lapwing_branch_chatter, only: ball_t, chatter_rest
  use lapwing_system_oscillation, only: damped_t, damped, free_matrix
  implicit none
  private
  public :: motion_t, equations_of, flight, contact, chatter, rest

  integer, parameter :: flight = 0, contact = 1, chatter = 2, rest = 3    !! arcs
  integer, parameter :: rebound = 0, go_on = 1, release = 2, chatter_end = 3, at_kink = 4

  real(wp), parameter :: no_length = 1e-300_wp    !! of an arc; differences over it are limits

  !> What moves, and how often in a repetition.
  type :: motion_t
    type(curve_t) :: curve             !! flank and response
    type(ball_t) :: ball               !! force, restitution, gap
    real(wp) :: xi = 0                 !! damping ratio
    logical :: absolute = .false.      !! impacts of the tooth's own velocity
    logical :: struck = .true.         !! whether impacts are impacts: not `compliant`
    integer :: cycles = 1              !! mesh cycles of a repetition
    real(wp) :: scale = 1              !! rad; of speeds over the period
  end type motion_t

  !> What is known at an event.
  type :: event_t
    real(wp) :: phase = 0, speed = 0   !! mesh periods; rad per tau into the flank, before it
    real(wp) :: sign = 1               !! -1: the coast flank
    real(wp) :: g(0:5) = 0, h(0:5) = 0 !! the transmission error's motion, and the flank's
    real(wp) :: q(2) = 0               !! engaged response and its rate
    real(wp) :: after = 0              !! speed after it
    real(wp) :: by_speed = 1, by_time = 0   !! its derivatives
    integer :: flank = 1, piece = 0
    logical :: moves = .true.          !! whether the flank moves
  end type event_t

contains

  !> Residuals, two for each event, and their derivatives by phase and scaled speed of the event
  !> before (`one`) and of the event (`two`).
  subroutine equations_of(motion, layout, jumps, z, residual, one, two)
    type(motion_t), intent(in) :: motion           !! what moves, and how
    integer, intent(in) :: layout(:, :)            !! (4, n) kind, flank, piece, arc
    real(wp), intent(in) :: jumps(:)               !! (n) slope jump where the event's piece begins
    real(wp), intent(in) :: z(:)                   !! (2 n) phases and scaled speeds
    real(wp), intent(out) :: residual(:, :)        !! (2, n)
    real(wp), intent(out) :: one(:, :, :)          !! (2, 2, n) equation, unknown, event
    real(wp), intent(out) :: two(:, :, :)          !! the same
    type(event_t) :: before, here
    type(damped_t) :: damping
    real(wp) :: s, unit, shift
    integer :: j, n, piece
    n = size(layout, 2)
    damping = damped(motion%xi)
    one = 0
    two = 0
    before = event_of(motion, layout, n, z)
    do j = 1, n
      here = event_of(motion, layout, j, z)
      shift = before%phase
      piece = before%piece
      if (j == 1) then
        shift = shift - motion%cycles
        piece = piece - motion%curve%pieces*motion%cycles
      end if
      s = (here%phase - shift)*motion%curve%period
      ! An arc of no length stands for the limit; its equation is still regular.
      if (s == 0) s = no_length
      select case (layout(4, j))
      case (flight)
        call by_flight(motion, before, here, s, piece, residual(:, j), one(:, :, j), two(:, :, j))
      case (contact)
        call by_contact(motion, damping, before, here, s, residual(:, j), one(:, :, j), &
            two(:, :, j))
      case (chatter)
        call by_chatter(motion, before, here, s, residual(:, j), one(:, :, j), two(:, :, j))
      case default
        call by_rest(motion, here, layout(1, j) == at_kink, jumps(j), residual(:, j), two(:, :, j))
      end select
      before = here
    end do
    ! By phase and by scaled speed.
    unit = motion%scale/motion%curve%period
    one(:, 1, :) = one(:, 1, :)*motion%curve%period
    two(:, 1, :) = two(:, 1, :)*motion%curve%period
    one(:, 2, :) = one(:, 2, :)*unit
    two(:, 2, :) = two(:, 2, :)*unit
  end subroutine equations_of

  !> What is known at an event.
  type(event_t) function event_of(motion, layout, k, z) result(self)
    type(motion_t), intent(in) :: motion   !! what moves
    integer, intent(in) :: layout(:, :)    !! (4, n) kind, flank, piece, arc
    integer, intent(in) :: k               !! which event
    real(wp), intent(in) :: z(:)           !! (2 n) phases and scaled speeds
    real(wp) :: kick
    integer :: kind
    kind = layout(1, k)
    self%flank = layout(2, k)
    self%piece = layout(3, k)
    self%phase = z(2*k - 1)
    self%speed = z(2*k)*(motion%scale/motion%curve%period)
    self%sign = merge(1.0_wp, -1.0_wp, self%flank == 1)
    self%moves = self%flank == 1 .or. motion%ball%back_moves
    self%g = derivatives(motion%curve, self%phase, self%piece)
    self%h = merge(self%g, 0.0_wp, self%moves)
    if (self%flank == 2) self%h(0) = self%h(0) - motion%ball%gap
    if (layout(4, k) == contact .or. layout(4, modulo(k, size(layout, 2)) + 1) == contact) then
      if (self%moves) self%q = response(motion%curve, self%phase, self%piece)
    end if
    self%after = self%speed
    if (motion%struck .and. (kind <= go_on .or. (kind == at_kink .and. self%speed > 0))) then
      self%by_speed = -motion%ball%restitution
      self%after = -motion%ball%restitution*self%speed
      if (motion%absolute) then
        kick = -(1 + motion%ball%restitution)*self%sign
        self%after = self%after + kick*self%h(1)
        self%by_time = kick*self%h(2)
      end if
    end if
    if (kind == chatter_end) then
      self%after = 0
      self%by_speed = 0
    end if
  end function event_of

  subroutine by_flight(motion, before, here, s, piece, residual, one, two)
    type(motion_t), intent(in) :: motion       !! what moves
    type(event_t), intent(in) :: before, here  !! the arc's ends
    real(wp), intent(in) :: s                  !! its length, tau
    integer, intent(in) :: piece               !! that of its beginning, as the end's is counted
    real(wp), intent(out) :: residual(2)       !! both equations
    real(wp), intent(inout) :: one(2, 2), two(2, 2)   !! derivatives
    real(wp) :: begun, lean, arrival, over, factor, by_start, carried, lean_along, both
    logical :: same
    factor = motion%curve%period/motion%scale
    same = before%flank == here%flank
    both = here%sign*before%sign
    begun = before%sign*before%after
    arrival = here%sign*(before%h(1) + begun + motion%ball%force*s - here%h(1))
    over = merge(s, motion%curve%period, same)
    if (same .and. piece == here%piece .and. s < 0.5_wp*motion%curve%period) then
      lean = before%after + here%sign*0.5_wp*motion%ball%force*s
      if (before%moves) lean = lean - here%sign*rise(motion%curve, before%phase, before%piece, &
          before%g, s, .false.)
    else
      ! Distance over s along one flank, distance over the period to the other.
      lean = here%sign*(before%h(0) + (before%h(1) + begun)*s + 0.5_wp*motion%ball%force*s*s &
          - here%h(0))/over
    end if
    residual = factor*[lean, arrival - here%speed]
    by_start = here%sign*(before%h(2) + before%sign*before%by_time - motion%ball%force)
    carried = both*before%by_speed
    lean_along = merge(lean, 0.0_wp, same)
    two(1, 1) = factor*(arrival - lean_along)/over
    one(1, 1) = factor*(by_start*s + lean_along - both*before%after)/over
    one(1, 2) = factor*carried*s/over
    if (same .and. s == no_length) then
      two(1, 1) = 0.5_wp*factor*here%sign*(motion%ball%force - here%h(2))
      one(1, 1) = factor*by_start + two(1, 1)
    end if
    two(2, 1) = factor*here%sign*(motion%ball%force - here%h(2))
    one(2, 1) = factor*by_start
    one(2, 2) = factor*carried
    two(2, 2) = -factor
  end subroutine by_flight

  subroutine by_contact(motion, damping, before, here, s, residual, one, two)
    type(motion_t), intent(in) :: motion       !! what moves
    type(damped_t), intent(in) :: damping      !! its damping, prepared
    type(event_t), intent(in) :: before, here  !! the arc's ends
    real(wp), intent(in) :: s                  !! its length, tau
    real(wp), intent(out) :: residual(2)       !! both equations
    real(wp), intent(inout) :: one(2, 2), two(2, 2)   !! derivatives
    real(wp) :: free(2, 2), moved(2), late(2), fast(2), lean, arrival, factor, press(2)
    factor = motion%curve%period/motion%scale
    free = free_matrix(damping, s)
    moved = matmul(free, [-here%sign*(motion%ball%force + before%q(1)), &
        before%after - here%sign*before%q(2)])
    lean = (here%sign*(motion%ball%force + here%q(1)) + moved(1))/s
    arrival = here%sign*here%q(2) + moved(2)
    residual = factor*[lean, arrival - here%speed]
    press = [before%sign*(motion%ball%force - before%h(2)), &
        here%sign*(motion%ball%force - here%h(2))]
    late = matmul(free, [-before%after, before%by_time - press(1) + 2*motion%xi*before%after])
    fast = free(:, 2)*before%by_speed
    two(1, 1) = factor*(arrival - lean)/s
    one(1, 1) = factor*(late(1) + lean)/s
    one(1, 2) = factor*fast(1)/s
    if (s == no_length) then
      two(1, 1) = 0.5_wp*factor*(press(2) - 2*motion%xi*arrival)
      one(1, 1) = factor*(before%by_time - press(1) + 2*motion%xi*before%after) + two(1, 1)
    end if
    two(2, 1) = factor*(press(2) - 2*motion%xi*arrival - lean*s)
    one(2, 1) = factor*late(2)
    one(2, 2) = factor*fast(2)
    two(2, 2) = -factor
  end subroutine by_contact

  subroutine by_chatter(motion, before, here, s, residual, one, two)
    type(motion_t), intent(in) :: motion       !! what moves
    type(event_t), intent(in) :: before, here  !! the arc's ends
    real(wp), intent(in) :: s                  !! its length, tau
    real(wp), intent(out) :: residual(2)       !! both equations
    real(wp), intent(inout) :: one(2, 2), two(2, 2)   !! derivatives
    real(wp) :: length, by_speed, by_time
    call chatter_rest(motion%curve, motion%ball, before%flank, before%phase, before%piece, &
        -before%after, length, by_speed, by_time)
    residual = [(s - length)/motion%curve%period, -here%speed*(motion%curve%period/motion%scale)]
    two(1, 1) = 1/motion%curve%period
    one(1, 1) = (-1 - by_time + by_speed*before%by_time)/motion%curve%period
    one(1, 2) = by_speed*before%by_speed/motion%curve%period
    two(2, 2) = -motion%curve%period/motion%scale
  end subroutine by_chatter

  subroutine by_rest(motion, here, at_a_kink, jump, residual, two)
    type(motion_t), intent(in) :: motion       !! what moves
    type(event_t), intent(in) :: here          !! the event that ends it
    logical, intent(in) :: at_a_kink           !! whether it is at a kink
    real(wp), intent(in) :: jump               !! slope jump there
    real(wp), intent(out) :: residual(2)       !! both equations
    real(wp), intent(inout) :: two(2, 2)       !! derivatives
    real(wp) :: thrown
    thrown = 0
    if (at_a_kink) then
      residual(1) = here%phase - begin_of(motion%curve, here%piece)
      two(1, 1) = 1/motion%curve%period
      thrown = -here%sign*jump
    else
      residual(1) = here%sign*(motion%ball%force - here%h(2))*motion%curve%period**2/motion%scale
      two(1, 1) = -here%sign*here%h(3)*motion%curve%period**2/motion%scale
    end if
    residual(2) = (thrown - here%speed)*motion%curve%period/motion%scale
    two(2, 2) = -motion%curve%period/motion%scale
  end subroutine by_rest

  pure real(wp) function begin_of(curve, piece) result(phase)
    use lapwing_branch_curve, only: piece_begin
    type(curve_t), intent(in) :: curve  !! flank
    integer, intent(in) :: piece        !! its piece
    phase = ieee_value(phase, ieee_quiet_nan)
    if (curve%pieces > 0) phase = piece_begin(curve, piece)
  end function begin_of

end module lapwing_branch_equations
