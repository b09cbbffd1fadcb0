!> The reduced lapping oscillator: theta'' = F in flight, a damped spring in contact, flanks that
!> move with the transmission error. Equations: docs/model.md.
!>
!> Local coordinates are z = (position, velocity) in the Galilean frame that at s = 0 stands and
!> moves with the flank last touched, y = (distance, velocity) relative to that flank. The flank
!> then starts at zero with zero slope, and a bounce of any size keeps its relative precision.
module lapwing_oscillator
  use lapwing_kinds, only: wp
  use lapwing_codes, only: separation, drive_flank, coast_flank, law_compliant, law_rigid, &
      law_absolute, gap_symmetric, gap_one_flank
  use lapwing_parameters, only: parameters_t, natural_angle, felt_jump
  use lapwing_polynomial, only: max_degree, horner, horner_slope, value_and_slope, taylor_shift, &
      never_below
  use lapwing_system, only: system_t, instant_t, frame_t, motion_t, step_t, max_states, &
      dense_degree, richardson, sixth, change
  use lapwing_transmission_error, only: te_table_t, te_table, find_jumps, locate_piece, piece_at, &
      expand_at, flank_motion_at
  implicit none
  private
  public :: oscillator_t, oscillator, open_table_frame, open_contact_frame, frame_about, impact_law

  type, extends(system_t) :: oscillator_t
    type(te_table_t) :: table             !! g over one mesh period
    real(wp) :: force = 1                 !! F, rad
    real(wp) :: damping = 0               !! 2 xi
    real(wp) :: width = 1                 !! distance between the flanks, rad
    real(wp) :: angle_scale = 1           !! natural size of angles, rad
    real(wp) :: flight_velocity_scale = 1 !! natural size of velocities in flight
    logical :: absolute = .false.         !! impact law of absolute velocities
    logical :: coast_moves = .true.       !! whether the coast flank moves with g
    logical :: alike = .true.             !! whether all flanks there are move with g
  contains
    procedure :: open_frame => open_step_frame
    procedure :: flank_motion, change_force
    procedure :: next_piece, derivatives, gap, contact, commit, pressing
    procedure :: rebound, sums_chatter, launch, pass_knot, scales, observe, stages, stay, unfold, leap
  end type oscillator_t

contains

  !> Oscillator from its parameters and its transmission error over mesh phase.
  function oscillator(parameters, knots, coefficients, kinks) result(self)
    type(parameters_t), intent(in) :: parameters  !! dimensionless parameters
    real(wp), intent(in) :: knots(:)              !! (n + 1) mesh phase, 0 to 1
    real(wp), intent(in) :: coefficients(0:, :)   !! (0:5, n) rad per mesh period**k
    logical, intent(in) :: kinks(:)               !! (n) slope jump at knots(i)
    type(oscillator_t) :: self
    real(wp), parameter :: two_pi = 8*atan(1.0_wp)
    associate (p => parameters)
      self%n_states = 2
      self%n_flanks = merge(1, 2, p%gap == gap_one_flank)
      self%period = two_pi/p%mesh_frequency_ratio
      self%compliant = p%contact_law == law_compliant
      self%rigid = p%contact_law == law_rigid
      self%restitution = p%restitution
      self%damping = 2*p%damping_ratio
      self%width = merge(2*p%backlash, p%backlash, p%gap == gap_symmetric)
      self%absolute = p%impact_law == law_absolute
      self%coast_moves = p%back_flank_te
      self%alike = self%n_flanks == 1 .or. self%coast_moves
      call set_force(self, p)
      self%table = te_table(knots, coefficients, kinks, p%flank_scale, self%period, felt_jump(p))
    end associate
  end function oscillator

  !> The force, and the scales that hang on it.
  pure subroutine set_force(self, p)
    class(oscillator_t), intent(inout) :: self
    type(parameters_t), intent(in) :: p      !! dimensionless parameters
    self%force = p%force
    self%angle_scale = natural_angle(p)
    self%flight_velocity_scale = self%angle_scale*min(1.0_wp, p%mesh_frequency_ratio)
  end subroutine set_force

  !> The same oscillator under another force.
  pure subroutine change_force(self, parameters)
    class(oscillator_t), intent(inout) :: self
    type(parameters_t), intent(in) :: parameters   !! dimensionless parameters
    call set_force(self, parameters)
    call find_jumps(self%table, felt_jump(parameters))
  end subroutine change_force

  !> The frame of a step: in contact with a moving flank without the flanks themselves, which most
  !> such steps never ask for.
  pure subroutine open_step_frame(self, instant, frame, z)
    class(oscillator_t), intent(in) :: self
    type(instant_t), intent(in) :: instant       !! where the step begins
    type(frame_t), intent(out) :: frame          !! its frame
    real(wp), intent(out) :: z(max_states)       !! local coordinates of the instant
    if (instant%motion_state == separation .or. self%rigid .or. .not. self%alike) then
      call open_table_frame(self, instant, frame, z)
    else
      call open_contact_frame(self, instant, frame)
      z = instant%y
    end if
  end subroutine open_step_frame

  !> The frame of a step in contact, its flanks left for `unfold`.
  pure subroutine open_contact_frame(self, instant, frame)
    class(oscillator_t), intent(in) :: self
    type(instant_t), intent(in) :: instant       !! where the step begins
    type(frame_t), intent(inout) :: frame        !! its frame
    associate (table => self%table, t => instant%t)
      frame%folded = .true.
      frame%chart = instant%chart
      frame%t = t
      frame%piece = piece_at(table, t)
      frame%piece_begin = 0
      frame%piece_end = table%knot(frame%piece + 1) - t
      frame%stop_knot = table%next_felt(frame%piece)
      frame%stop = table%knot(frame%stop_knot) - t
      call value_and_slope(table%coefficient(:, frame%piece), t - table%knot(frame%piece), &
          frame%origin, frame%origin_rate)
    end associate
  end subroutine open_contact_frame

  !> Fill in the flanks of a frame that was opened without them.
  pure subroutine unfold(self, frame)
    class(oscillator_t), intent(in) :: self
    type(frame_t), intent(inout) :: frame        !! frame as opened
    real(wp) :: g(0:max_degree)
    if (.not. frame%folded) return
    call expand_at(self%table, frame%piece, frame%t, g)
    g(0:1) = 0
    call set_flanks(self, g, frame)
    frame%folded = .false.
  end subroutine unfold

  !> Open the Galilean frame of the flank last touched.
  pure subroutine open_table_frame(self, instant, frame, z)
    class(oscillator_t), intent(in) :: self
    type(instant_t), intent(in) :: instant       !! where the step begins
    type(frame_t), intent(out) :: frame          !! its frame
    real(wp), intent(out) :: z(max_states)       !! local coordinates of the instant
    real(wp) :: g(0:max_degree)
    associate (table => self%table)
      frame%piece = locate_piece(table, instant%t, instant%piece)
      frame%piece_end = table%knot(frame%piece + 1) - instant%t
      frame%stop_knot = table%next_kink(frame%piece)
      if (instant%motion_state /= separation .and. .not. self%rigid) then
        frame%stop_knot = table%next_felt(frame%piece)
      end if
      frame%stop = table%knot(frame%stop_knot) - instant%t
      call expand_at(table, frame%piece, instant%t, g)
    end associate
    call frame_about(self, instant, g, frame, z)
  end subroutine open_table_frame

  !> Flanks in the frame, from the Taylor coefficients of g.
  pure subroutine frame_about(self, instant, taylor, frame, z)
    class(oscillator_t), intent(in) :: self
    type(instant_t), intent(in) :: instant           !! where the step begins
    real(wp), intent(in) :: taylor(0:max_degree)     !! of g there
    type(frame_t), intent(inout) :: frame            !! its frame
    real(wp), intent(out) :: z(max_states)           !! local coordinates of the instant
    real(wp) :: g(0:max_degree)
    g = taylor
    frame%chart = instant%chart
    frame%t = instant%t
    frame%origin = g(0)
    if (frame%chart == drive_flank .or. self%coast_moves) then
      frame%origin_rate = g(1)
      g(0:1) = 0
    end if
    frame%flank(:, drive_flank) = g
    if (self%coast_moves) then
      frame%flank(:, coast_flank) = g
    else if (frame%chart == drive_flank) then
      frame%flank(0:1, coast_flank) = [-frame%origin, -frame%origin_rate]
    end if
    if (frame%chart == drive_flank) then
      frame%flank(0, coast_flank) = frame%flank(0, coast_flank) - self%width
    else
      frame%flank(0, drive_flank) = frame%flank(0, drive_flank) + self%width
    end if
    z = instant%y
  end subroutine frame_about

  !> g and g'.
  pure subroutine flank_motion(self, t, piece, g, slope)
    class(oscillator_t), intent(in) :: self
    real(wp), intent(in) :: t                    !! time in the cycle
    integer, intent(in) :: piece                 !! table piece to look at first
    real(wp), intent(out) :: g, slope            !! position and velocity
    call flank_motion_at(self%table, t, piece, g, slope)
  end subroutine flank_motion

  !> Carry position and velocity of the flanks over to the next piece, whose bend takes over.
  pure subroutine next_piece(self, frame)
    class(oscillator_t), intent(in) :: self
    type(frame_t), intent(inout) :: frame        !! frame, moved one piece on
    real(wp) :: span, position, slope
    integer :: flank
    span = frame%piece_end - frame%piece_begin
    frame%piece = frame%piece + 1
    frame%piece_begin = frame%piece_end
    frame%piece_end = self%table%knot(frame%piece + 1) - frame%t
    do flank = 1, self%n_flanks
      position = horner(frame%flank(:, flank), span)
      slope = horner_slope(frame%flank(:, flank), span)
      if (flank == drive_flank .or. self%coast_moves) then
        ! Off kinks the jump is rounding, but left out it would add up to a mean force.
        slope = slope + self%table%slope_jump(frame%piece)
        frame%flank(2:, flank) = self%table%coefficient(2:, frame%piece)
      end if
      frame%flank(0:1, flank) = [position, slope]
    end do
  end subroutine next_piece

  !> A step in contact that certainly stays inside, if the flank pushes as much as it can anywhere,
  !> by s**2/2 max(g'').
  pure subroutine stay(self, frame, motion, z_end, instant, stays)
    class(oscillator_t), intent(in) :: self
    type(frame_t), intent(in) :: frame           !! frame as opened
    type(motion_t), intent(in) :: motion         !! step as a polynomial
    real(wp), intent(in) :: z_end(max_states)    !! local coordinates at its end
    type(instant_t), intent(inout) :: instant    !! its beginning; if it stays, piece and y move on
    logical, intent(out) :: stays                !! whether it does
    real(wp) :: push, least, position, slope
    stays = .false.
    if (.not. self%alike) return
    associate (z => motion%dense(:, 1), flank => instant%motion_state)
      push = 0.5_wp*motion%h**2*max(0.0_wp, self%table%push(flank))
      if (flank == drive_flank) then
        least = never_below([z(2), z(3) - push, z(4), z(5), z(6), 0.0_wp])
        if (instant%touching /= flank) least = z(1) + min(0.0_wp, least)
      else
        least = never_below([-z(2), -z(3) - push, -z(4), -z(5), -z(6), 0.0_wp])
        if (instant%touching /= flank) least = min(0.0_wp, least) - z(1)
      end if
    end associate
    stays = least > 0
    if (.not. stays) return
    call flank_in_frame(self, frame, frame%chart, motion%h, instant%piece, position, slope)
    instant%y(1:2) = [z_end(1) - position, z_end(2) - slope]
  end subroutine stay

  !> In flight, up to the piece on which a flank might be met. Left to the search of every piece: a
  !> coast flank that does not move with the drive flank.
  pure subroutine leap(self, motion, frame, touching, clear)
    class(oscillator_t), intent(in) :: self
    type(motion_t), intent(in) :: motion         !! step as a polynomial
    type(frame_t), intent(inout) :: frame        !! frame, on the piece to be searched next
    integer, intent(inout) :: touching           !! flank at zero distance where it begins, or none
    logical, intent(out) :: clear                !! whether nothing is met up to the step's end
    real(wp) :: s
    clear = .false.
    if (.not. self%alike) return
    s = frame%piece_begin
    do
      s = s + time_of_grace(self, frame, touching, motion, s)
      clear = s >= motion%h
      if (.not. clear .and. s <= frame%piece_end) return
      call move_to(self, frame, min(s, motion%h))
      if (clear) return
      touching = 0
    end do
  end subroutine leap

  !> Time for which a flight, at s of a step, can meet no flank: the distance begins with the value
  !> and slope it has there and bends towards the flank as much as it can anywhere.
  pure real(wp) function time_of_grace(self, frame, touching, motion, s)
    class(oscillator_t), intent(in) :: self
    type(frame_t), intent(in) :: frame           !! frame, on the piece that holds s
    integer, intent(in) :: touching              !! flank at zero distance there, or none
    type(motion_t), intent(in) :: motion         !! step as a polynomial
    real(wp), intent(in) :: s                    !! time since the frame was opened
    real(wp), parameter :: caution = 1 - 2.0_wp**(-20)   !! far more than the rounding of a root
    real(wp) :: z(max_states), y(max_states), phi
    z(1:2) = [horner(motion%dense(:, 1), s/motion%h), horner(motion%dense(:, 2), s/motion%h)]
    call commit(self, frame, s, z, frame%chart, y)
    phi = y(1)
    if (frame%chart == coast_flank) phi = phi - self%width
    time_of_grace = no_sooner(merge(0.0_wp, -phi, touching == drive_flank), y(2), &
        self%force + self%table%push(coast_flank))
    if (self%n_flanks == 2) then
      if (frame%chart == drive_flank) y(1) = y(1) + self%width
      time_of_grace = min(time_of_grace, no_sooner(merge(0.0_wp, y(1), touching == coast_flank), &
          -y(2), self%table%push(drive_flank) - self%force))
    end if
    time_of_grace = caution*time_of_grace
  end function time_of_grace

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

  !> Move a frame on to the piece that holds s, before the stop. Not for flanks of which one stands.
  pure subroutine move_to(self, frame, s)
    class(oscillator_t), intent(in) :: self
    type(frame_t), intent(inout) :: frame        !! frame, moved on
    real(wp), intent(in) :: s                    !! time since it was opened
    real(wp) :: g(0:max_degree)
    integer :: piece
    if (s <= frame%piece_end) return
    piece = min(piece_at(self%table, frame%t + s), frame%stop_knot - 1)
    if (piece <= frame%piece) return
    frame%piece = piece
    frame%piece_begin = self%table%knot(piece) - frame%t
    frame%piece_end = self%table%knot(piece + 1) - frame%t
    g = self%table%coefficient(:, piece)
    g(0) = g(0) - frame%origin - frame%origin_rate*frame%piece_begin
    g(1) = g(1) - frame%origin_rate
    call set_flanks(self, g, frame)
  end subroutine move_to

  !> Flanks that move alike, from the polynomial of the chart's own.
  pure subroutine set_flanks(self, g, frame)
    class(oscillator_t), intent(in) :: self
    real(wp), intent(in) :: g(0:max_degree)      !! flank of the chart
    type(frame_t), intent(inout) :: frame        !! frame
    frame%flank(:, drive_flank) = g
    frame%flank(:, coast_flank) = g
    if (frame%chart == drive_flank) then
      frame%flank(0, coast_flank) = g(0) - self%width
    else
      frame%flank(0, drive_flank) = g(0) + self%width
    end if
  end subroutine set_flanks

  !> Flight under the constant force, or the damped spring of the flank in contact.
  pure subroutine derivatives(self, frame, motion_state, s, z, rate)
    class(oscillator_t), intent(in) :: self
    type(frame_t), intent(in) :: frame           !! frame as opened
    integer, intent(in) :: motion_state          !! motion state
    real(wp), intent(in) :: s                    !! time since the frame was opened
    real(wp), intent(in) :: z(:)                 !! position and velocity
    real(wp), intent(out) :: rate(:)             !! velocity and acceleration
    rate(1) = z(2)
    rate(2) = self%force
    if (motion_state == separation) return
    rate(2) = (drive(self, frame, motion_state, s) - z(1)) - self%damping*z(2)
  end subroutine derivatives

  !> What drives the damped spring in contact: the force, and the flank's motion in the frame.
  pure real(wp) function drive(self, frame, flank, s)
    class(oscillator_t), intent(in) :: self
    type(frame_t), intent(in) :: frame           !! frame as opened
    integer, intent(in) :: flank                 !! flank in contact
    real(wp), intent(in) :: s                    !! time since the frame was opened
    real(wp) :: position, slope
    integer :: piece
    drive = self%force
    if (s <= 0) return
    call flank_in_frame(self, frame, flank, s, piece, position, slope)
    drive = self%force + (position + self%damping*slope)
  end function drive

  !> The same at the four quarters of a step that ends on the piece where it begins.
  pure subroutine drive_on_piece(self, frame, h, driven)
    class(oscillator_t), intent(in) :: self
    type(frame_t), intent(in) :: frame           !! frame as opened
    real(wp), intent(in) :: h                    !! step
    real(wp), intent(out) :: driven(4)           !! at its quarters
    real(wp), dimension(4) :: s, x, position, slope
    integer :: k
    associate (c => self%table%coefficient(:, frame%piece))
      s = [1, 2, 3, 4]*(0.25_wp*h)
      x = frame%t + s - self%table%knot(frame%piece)
      position = c(max_degree + 1)
      slope = 0
      do k = max_degree, 1, -1
        slope = slope*x + position
        position = position*x + c(k)
      end do
    end associate
    position = position - frame%origin - frame%origin_rate*s
    slope = slope - frame%origin_rate
    driven = self%force + (position + self%damping*slope)
  end subroutine drive_on_piece

  !> Position and velocity, in the frame, of the flank of its chart.
  pure subroutine flank_in_frame(self, frame, flank, s, piece, position, slope)
    class(oscillator_t), intent(in) :: self
    type(frame_t), intent(in) :: frame           !! frame as opened
    integer, intent(in) :: flank                 !! the flank
    real(wp), intent(in) :: s                    !! time since the frame was opened
    integer, intent(out) :: piece                !! piece that holds s
    real(wp), intent(out) :: position, slope     !! in the frame
    ! What ends the step, at the last stage, has not happened yet.
    piece = min(piece_at(self%table, frame%t + s), frame%stop_knot - 1)
    position = 0
    slope = 0
    if (flank == coast_flank .and. .not. self%coast_moves) return
    call value_and_slope(self%table%coefficient(:, piece), frame%t + s - self%table%knot(piece), &
        position, slope)
    position = position - frame%origin - frame%origin_rate*s
    slope = slope - frame%origin_rate
  end subroutine flank_in_frame

  !> The stages of `stages_by_dispatch` written out for a parabola and for a damped spring.
  subroutine stages(self, frame, motion_state, h, z, dense, step)
    class(oscillator_t), intent(in) :: self
    type(frame_t), intent(in) :: frame             !! frame as opened
    integer, intent(in) :: motion_state            !! motion state
    real(wp), intent(in) :: h                      !! step
    real(wp), intent(in) :: z(max_states)          !! local coordinates at s = 0
    logical, intent(in) :: dense                   !! whether the rate at the end is wanted
    type(step_t), intent(inout) :: step            !! the result
    real(wp) :: driven(4)   ! by what, at the quarters of the step
    integer :: i
    if (motion_state == separation) then
      call fly(self%force, h, z, step)
      return
    end if
    if (h <= frame%piece_end .and. (motion_state == drive_flank .or. self%coast_moves)) then
      call drive_on_piece(self, frame, h, driven)
    else
      do i = 1, 4
        driven(i) = drive(self, frame, motion_state, i*(0.25_wp*h))
      end do
    end if
    call spring_stages(self%damping, self%force, driven, h, z(1:2), step)
  end subroutine stages

  !> Two classical steps of the damped spring and one over both, extrapolated.
  pure subroutine spring_stages(damping, force, driven, h, z, step)
    real(wp), intent(in) :: damping          !! 2 xi
    real(wp), intent(in) :: force            !! what drives it at s = 0
    real(wp), intent(in) :: driven(4)        !! and at the quarters of the step
    real(wp), intent(in) :: h                !! step
    real(wp), intent(in) :: z(2)             !! position and velocity at s = 0
    type(step_t), intent(inout) :: step      !! the result
    real(wp), dimension(2) :: middle, fine, coarse
    real(wp) :: begin, turn
    begin = (force - z(1)) - damping*z(2)
    call spring_step(damping, driven(1), driven(2), 0.5_wp*h, z, begin, middle)
    call spring_step(damping, driven(2), driven(4), h, z, begin, coarse)
    turn = (driven(2) - middle(1)) - damping*middle(2)
    call spring_step(damping, driven(3), driven(4), 0.5_wp*h, middle, turn, fine)
    step%correction(1:2) = richardson*(fine - coarse)
    step%middle(1:2) = middle + 0.5_wp*step%correction(1:2)
    step%end(1:2) = fine + step%correction(1:2)
    step%rate_begin(1:2) = [z(2), begin]
    step%rate_middle(1:2) = [middle(2), turn]
    step%rate_end(1:2) = [step%end(2), (driven(4) - step%end(1)) - damping*step%end(2)]
  end subroutine spring_stages

  !> One classical step of x'' = D(s) - x - 2 xi x' in its four accelerations. Each stage waits for
  !> the one before by a product and a difference only: stages are most of what a step takes.
  pure subroutine spring_step(damping, half_way, at_end, h, z, a1, z_end)
    real(wp), intent(in) :: damping              !! 2 xi
    real(wp), intent(in) :: half_way, at_end     !! D at h/2 and h
    real(wp), intent(in) :: h                    !! step
    real(wp), intent(in) :: z(2)                 !! position and velocity at s = 0
    real(wp), intent(in) :: a1                   !! acceleration there
    real(wp), intent(out) :: z_end(2)            !! position and velocity at s = h
    real(wp) :: half, rest, a2, a3, a4
    half = 0.5_wp*h
    rest = (half_way - damping*z(2)) - (z(1) + half*z(2))
    a2 = rest - (damping*half)*a1
    a3 = (rest - half**2*a1) - (damping*half)*a2
    rest = (at_end - damping*z(2)) - (z(1) + h*z(2))
    a4 = (rest - (h*half)*a2) - (damping*h)*a3
    z_end(1) = z(1) + (h*(z(2) + half*a1) + (h**2*sixth)*((a2 - a1) + (a3 - a1)))
    z_end(2) = z(2) + change(h, a1, a2, a3, a4)
  end subroutine spring_step

  !> What the stages give under a constant force, where the formula is exact.
  pure subroutine fly(force, h, z, step)
    real(wp), intent(in) :: force            !! theta''
    real(wp), intent(in) :: h                !! step
    real(wp), intent(in) :: z(:)             !! position and velocity at s = 0
    type(step_t), intent(inout) :: step      !! the result
    real(wp) :: half
    half = 0.5_wp*h
    step%middle(1) = z(1) + half*(z(2) + 0.5_wp*half*force)
    step%middle(2) = z(2) + half*force
    step%end(1) = z(1) + h*(z(2) + half*force)
    step%end(2) = z(2) + h*force
    step%correction(1:2) = 0
    step%rate_begin(1:2) = [z(2), force]
    step%rate_middle(1:2) = [step%middle(2), force]
    step%rate_end(1:2) = [step%end(2), force]
  end subroutine fly

  !> Distance to a flank over the frame's piece.
  pure subroutine gap(self, frame, flank, motion, c)
    class(oscillator_t), intent(in) :: self
    type(frame_t), intent(in) :: frame           !! frame
    integer, intent(in) :: flank                 !! drive_flank or coast_flank
    type(motion_t), intent(in) :: motion         !! step as a polynomial
    real(wp), intent(out) :: c(0:max_degree)     !! coefficients in s - piece_begin
    real(wp) :: position(0:dense_degree), inverse, power
    integer :: k
    inverse = 1/motion%h
    power = 1
    do k = 0, dense_degree
      position(k) = motion%dense(k, 1)*power
      power = power*inverse
    end do
    if (frame%piece_begin > 0) call taylor_shift(position, frame%piece_begin)
    c = frame%flank(:, flank) - position
    if (flank == coast_flank) c = -c
  end subroutine gap

  !> Distance and approach velocity to a flank at s within the frame's piece.
  pure subroutine contact(self, frame, flank, s, z, distance, approach)
    class(oscillator_t), intent(in) :: self
    type(frame_t), intent(in) :: frame           !! frame
    integer, intent(in) :: flank                 !! flank
    real(wp), intent(in) :: s                    !! time since the frame was opened
    real(wp), intent(in) :: z(max_states)        !! local coordinates
    real(wp), intent(out) :: distance            !! positive in separation, rad
    real(wp), intent(out) :: approach            !! - d(distance)/d(tau)
    real(wp) :: y(max_states)
    call commit(self, frame, s, z, flank, y)
    distance = merge(-y(1), y(1), flank == drive_flank)
    approach = merge(y(2), -y(2), flank == drive_flank)
  end subroutine contact

  !> Position and velocity relative to a flank at s within the frame's piece.
  pure subroutine commit(self, frame, s, z, chart, y)
    class(oscillator_t), intent(in) :: self
    type(frame_t), intent(in) :: frame           !! frame
    real(wp), intent(in) :: s                    !! time since the frame was opened
    real(wp), intent(in) :: z(max_states)        !! local coordinates
    integer, intent(in) :: chart                 !! flank to refer to
    real(wp), intent(out) :: y(max_states)       !! state variables
    real(wp) :: x
    x = s - frame%piece_begin
    y = 0
    y(1) = z(1) - horner(frame%flank(:, chart), x)
    y(2) = z(2) - horner_slope(frame%flank(:, chart), x)
  end subroutine commit

  !> F - g'' at the drive flank, its opposite at the coast flank.
  pure subroutine pressing(self, frame, flank, s, z, c)
    class(oscillator_t), intent(in) :: self
    type(frame_t), intent(in) :: frame           !! frame
    integer, intent(in) :: flank                 !! flank
    real(wp), intent(in) :: s                    !! time since the frame was opened
    real(wp), intent(in) :: z(max_states)        !! local coordinates: without effect
    real(wp), intent(out) :: c(0:max_degree)     !! Taylor coefficients about s
    real(wp) :: path(0:max_degree)
    integer :: k
    path = frame%flank(:, flank)
    if (s > frame%piece_begin) call taylor_shift(path, s - frame%piece_begin)
    c = 0
    do k = 0, max_degree - 2
      c(k) = -(k + 1)*(k + 2)*path(k + 2)
    end do
    c(0) = c(0) + self%force
    if (flank == coast_flank) c = -c
  end subroutine pressing

  !> phi'+ = -eps phi'-; `absolute`: theta'+ = -eps theta'-.
  pure real(wp) function rebound(self, frame, flank, s, approach)
    class(oscillator_t), intent(in) :: self
    type(frame_t), intent(in) :: frame           !! frame
    integer, intent(in) :: flank                 !! flank struck
    real(wp), intent(in) :: s                    !! time since the frame was opened
    real(wp), intent(in) :: approach             !! approach velocity before
    real(wp) :: flank_velocity
    flank_velocity = 0
    if (self%absolute .and. (flank == drive_flank .or. self%coast_moves)) then
      flank_velocity = frame%origin_rate &
          + horner_slope(frame%flank(:, flank), s - frame%piece_begin)
    end if
    rebound = impact_law(self, flank, flank_velocity, approach)
  end function rebound

  !> The same where the flank's velocity is known (`relative`: without effect).
  pure real(wp) function impact_law(self, flank, flank_velocity, approach)
    class(oscillator_t), intent(in) :: self
    integer, intent(in) :: flank                 !! flank struck
    real(wp), intent(in) :: flank_velocity       !! its velocity; 0: it stands still
    real(wp), intent(in) :: approach             !! approach velocity before
    impact_law = -self%restitution*approach
    if (.not. self%absolute) return
    impact_law = impact_law - (1 + self%restitution) &
        *merge(flank_velocity, -flank_velocity, flank == drive_flank)
  end function impact_law

  !> Under `absolute` rebounds from a moving flank tend to a finite speed.
  pure logical function sums_chatter(self, flank)
    class(oscillator_t), intent(in) :: self
    integer, intent(in) :: flank                 !! flank
    sums_chatter = .not. self%absolute .or. (flank == coast_flank .and. .not. self%coast_moves)
  end function sums_chatter

  !> On the flank, with the given approach velocity.
  pure subroutine launch(self, flank, approach, y)
    class(oscillator_t), intent(in) :: self
    integer, intent(in) :: flank                 !! flank the chart refers to
    real(wp), intent(in) :: approach             !! approach velocity, negative: leaves
    real(wp), intent(inout) :: y(max_states)     !! state variables in the flank's chart
    y(1:self%n_states) = [0.0_wp, merge(approach, -approach, flank == drive_flank)]
  end subroutine launch

  !> Through a kink theta and theta' are continuous: phi' loses what g' gains.
  pure subroutine pass_knot(self, knot, instant, is_kink, jump)
    class(oscillator_t), intent(in) :: self
    integer, intent(in) :: knot                  !! knot reached
    type(instant_t), intent(inout) :: instant    !! state before, then after
    logical, intent(out) :: is_kink              !! whether the flank's slope jumps here
    real(wp), intent(out) :: jump                !! added to phi'
    if (knot > self%table%n) then
      instant%cycle = instant%cycle + 1
      instant%t = 0
      instant%piece = 1
    else
      instant%t = self%table%knot(knot)
      instant%piece = knot
    end if
    is_kink = self%table%kink(knot)
    jump = -self%table%slope_jump(knot)
    if (instant%chart == drive_flank .or. self%coast_moves) instant%y(2) = instant%y(2) + jump
  end subroutine pass_knot

  !> Angles by the smallest of backlash and motion; velocities by that per unit of tau, or per
  !> mesh radian in flight where that is slower.
  pure subroutine scales(self, motion_state, scale)
    class(oscillator_t), intent(in) :: self
    integer, intent(in) :: motion_state          !! motion state
    real(wp), intent(out) :: scale(max_states)   !! sizes
    scale = self%angle_scale
    if (motion_state == separation) scale(2) = self%flight_velocity_scale
  end subroutine scales

  !> phi and phi', whatever the chart.
  pure subroutine observe(self, instant, phi, phi_dot)
    class(oscillator_t), intent(in) :: self
    type(instant_t), intent(in) :: instant       !! where the system is
    real(wp), intent(out) :: phi, phi_dot        !! rad, rad per tau
    real(wp) :: g, slope
    phi = instant%y(1)
    phi_dot = instant%y(2)
    if (instant%chart == drive_flank) return
    phi = phi - self%width
    if (self%coast_moves) return
    call self%flank_motion(instant%t, instant%piece, g, slope)
    phi = phi - g
    phi_dot = phi_dot - slope
  end subroutine observe
end module lapwing_oscillator
