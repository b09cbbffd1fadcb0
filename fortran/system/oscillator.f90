!> The reduced lapping oscillator: theta'' = F in flight, a damped spring in contact, flanks that
!> move with the transmission error. Equations: docs/model.md.
!>
!> Local coordinates are z = (position, velocity) in the Galilean frame that at s = 0 stands and
!> moves with the flank last touched, y = (distance, velocity) relative to that flank. The flank
!> then starts at zero with zero slope, and a bounce of any size keeps its relative precision.
module lapwing_system_oscillator
  use lapwing_kinds, only: wp
  use lapwing_codes, only: separation, drive_flank, coast_flank, law_compliant, law_rigid, &
      law_absolute, gap_symmetric, gap_one_flank
  use lapwing_system_clearance, only: stays_inside
  use lapwing_system_frames, only: frame_about, flank_in_frame, flank_over_step
  use lapwing_system_flight_leaps, only: leap_over_pieces
  use lapwing_system_parameters, only: parameters_t, natural_angle, felt_jump
  use lapwing_polynomial_evaluation, only: max_degree, horner, horner_slope, taylor_shift
  use lapwing_system_spring_stages, only: spring_stages, flight_stages
  use lapwing_system, only: system_t, instant_t, frame_t, motion_t, step_t, max_states, &
      dense_degree
  use lapwing_flank_table, only: te_table_t, te_table, find_jumps, locate_piece, expand_at, &
      flank_motion_at
  implicit none
  private
  public :: oscillator_t, oscillator, open_table_frame, impact_law
  public :: drive_over_step

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
    procedure :: open_frame => open_table_frame
    procedure :: flank_motion, change_force
    procedure :: next_piece, derivatives, gap, contact, commit, pressing
    procedure :: rebound, sums_chatter, launch, pass_knot, scales, observe
    procedure :: stages, stay, leap
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
    call frame_about(instant, g, self%width, self%coast_moves, frame)
    z = instant%y
  end subroutine open_table_frame

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

  !> A step in contact that certainly stays inside the flank, to its end.
  pure subroutine stay(self, frame, motion, z_end, instant, stays)
    class(oscillator_t), intent(in) :: self
    type(frame_t), intent(in) :: frame           !! frame as opened
    type(motion_t), intent(in) :: motion         !! step as a polynomial
    real(wp), intent(in) :: z_end(max_states)    !! local coordinates at its end
    type(instant_t), intent(inout) :: instant    !! its beginning; if it stays, y is its end's
    logical, intent(out) :: stays                !! whether it does
    real(wp) :: position, slope
    stays = .false.
    if (.not. self%alike) return
    stays = stays_inside(self%table%push(instant%motion_state), instant%motion_state, &
        instant%touching, motion)
    if (.not. stays) return
    call flank_in_frame(self%table, frame, motion%h, position, slope)
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
    clear = .false.
    if (.not. self%alike) return
    call leap_over_pieces(self%table, self%width, self%n_flanks, self%force, motion, frame, &
        touching, clear)
  end subroutine leap

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
    rate(2) = (drive(self, frame, s) - z(1)) - self%damping*z(2)
  end subroutine derivatives

  !> What drives the damped spring in contact, at s: the force, and the flank's motion in the frame.
  pure real(wp) function drive(self, frame, s)
    class(oscillator_t), intent(in) :: self
    type(frame_t), intent(in) :: frame           !! frame as opened
    real(wp), intent(in) :: s                    !! time since the frame was opened
    real(wp) :: position, slope
    drive = self%force
    if (s <= 0 .or. stands(self, frame)) return
    call flank_in_frame(self%table, frame, s, position, slope)
    drive = self%force + (position + self%damping*slope)
  end function drive

  !> The same at the quarters of a step, and where the flank is at its end.
  pure subroutine drive_over_step(self, frame, h, driven, landing)
    class(oscillator_t), intent(in) :: self
    type(frame_t), intent(in) :: frame           !! frame as opened
    real(wp), intent(in) :: h                    !! step
    real(wp), intent(out) :: driven(4)           !! at its quarters
    real(wp), intent(out) :: landing(2)          !! flank's position and velocity at s = h
    real(wp) :: position(4), slope(4)
    driven = self%force
    landing = 0
    if (stands(self, frame)) return
    call flank_over_step(self%table, frame, h, position, slope)
    driven = self%force + (position + self%damping*slope)
    landing = [position(4), slope(4)]
  end subroutine drive_over_step

  !> Whether the flank of a frame's chart stands still.
  pure logical function stands(self, frame)
    class(oscillator_t), intent(in) :: self
    type(frame_t), intent(in) :: frame           !! frame
    stands = frame%chart == coast_flank .and. .not. self%coast_moves
  end function stands

  !> The stages of `stages_by_dispatch` written out for a parabola and for a damped spring.
  subroutine stages(self, frame, motion_state, h, z, dense, step)
    class(oscillator_t), intent(in) :: self
    type(frame_t), intent(in) :: frame             !! frame as opened
    integer, intent(in) :: motion_state            !! motion state
    real(wp), intent(in) :: h                      !! step
    real(wp), intent(in) :: z(max_states)          !! local coordinates at s = 0
    logical, intent(in) :: dense                   !! whether the rate at the end is wanted
    type(step_t), intent(inout) :: step            !! the result
    real(wp) :: driven(4), landing(2)
    if (motion_state == separation) then
      call flight_stages(self%force, h, z, step)
    else
      call drive_over_step(self, frame, h, driven, landing)
      call spring_stages(self%damping, self%force, driven, h, z(1:2), step)
    end if
  end subroutine stages

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
end module lapwing_system_oscillator
