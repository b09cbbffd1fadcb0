!> The reduced lapping oscillator: theta'' = F in flight, a damped spring in contact, flanks that
!> move with the transmission error. Equations: docs/model.md.
!>
!> Local coordinates are z = (position, velocity) in the Galilean frame that at s = 0 stands and
!> moves with the flank last touched, y = (distance, velocity) relative to that flank. The flank
!> then starts at zero with zero slope, and a bounce of any size keeps its relative precision.
module lapwing_system_oscillator
  use lapwing_kinds, only: wp
  use lapwing_codes, only: separation, no_flank, drive_flank, coast_flank, law_compliant, &
      law_rigid, law_absolute, gap_symmetric, gap_one_flank
  use lapwing_flank_series, only: harmonic_series_t, harmonic_series, expand_series, series_at, &
      bound_derivative
  use lapwing_system_exclusion, only: stays_inside, leap_over_pieces
  use lapwing_system_frames, only: open_on_piece, open_in_contact, frame_about, &
      distance_in_frame
  use lapwing_system_parameters, only: parameters_t, natural_angle, felt_jump
  use lapwing_polynomial_evaluation, only: max_degree, horner, horner_slope, taylor_shift
  use lapwing_system_spring_stages, only: drive, drive_over_step, spring_stages, flight_stages
  use lapwing_system, only: system_t, instant_t, frame_t, motion_t, step_t, max_states
  use lapwing_flank_table, only: te_table_t, make_table, find_jumps, locate_piece, expand_at, &
      flank_motion_at
  implicit none
  private
  public :: oscillator_t, make_oscillator

  type, extends(system_t) :: oscillator_t
    type(te_table_t) :: table             !! g over one mesh period
    logical :: harmonic = .false.         !! g is the series, the table one empty piece
    type(harmonic_series_t) :: series     !! g
    real(wp) :: force = 1                 !! F, rad
    real(wp) :: damping = 0               !! 2 xi
    real(wp) :: width = 1                 !! distance between the flanks, rad
    real(wp) :: angle_scale = 1           !! natural size of angles, rad
    real(wp) :: flight_velocity_scale = 1 !! natural size of velocities in flight
    logical :: coast_moves = .true.       !! whether the coast flank moves with g
    logical :: alike = .true.             !! whether all flanks there are move with g
  contains
    procedure :: flank_motion, change_force, open_frame, next_piece, derivatives, gap, contact
    procedure :: commit, pressing, rebound, sums_chatter, launch, pass_knot, scales, observe
    procedure :: begins_clear, limit_step, flank_velocity, stages, stay, leap
  end type oscillator_t

contains

  !> Oscillator from its parameters and its transmission error over mesh phase.
  subroutine make_oscillator(parameters, knots, coefficients, kinks, series, self, error)
    type(parameters_t), intent(in) :: parameters  !! dimensionless parameters
    real(wp), intent(in) :: knots(:)              !! (n + 1) mesh phase, 0 to 1
    real(wp), intent(in) :: coefficients(0:, :)   !! (0:5, n) rad per mesh period**k
    logical, intent(in) :: kinks(:)               !! (n) slope jump at knots(i)
    real(wp), intent(in) :: series(:, :)          !! (3, terms), first order -1: none
    type(oscillator_t), intent(out) :: self       !! oscillator
    integer, intent(out) :: error                 !! 0, or there is no memory for it
    real(wp), parameter :: two_pi = 8*atan(1.0_wp), no_motion(0:max_degree, 1) = 0
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
      self%harmonic = series(1, 1) >= 0
      if (self%harmonic) then
        self%series = harmonic_series(series, p%flank_scale, p%mesh_frequency_ratio)
        call make_table([0.0_wp, 1.0_wp], no_motion, [.false.], p%flank_scale, self%period, &
            felt_jump(p), self%table, error)
      else
        call make_table(knots, coefficients, kinks, p%flank_scale, self%period, felt_jump(p), &
            self%table, error)
      end if
      if (error /= 0) return
      call set_force(self, p)
    end associate
  end subroutine make_oscillator

  !> The force, and the scales that hang on it.
  pure subroutine set_force(self, p)
    class(oscillator_t), intent(inout) :: self
    type(parameters_t), intent(in) :: p      !! dimensionless parameters
    self%force = p%force
    self%angle_scale = natural_angle(p)
    self%flight_velocity_scale = self%angle_scale*min(1.0_wp, p%mesh_frequency_ratio)
    self%strongest = abs(p%force) + maxval(abs(self%table%push))
    if (self%harmonic) self%strongest = abs(p%force) + 2*bound_derivative(self%series, 2)
  end subroutine set_force

  !> The same oscillator under another force.
  pure subroutine change_force(self, parameters)
    class(oscillator_t), intent(inout) :: self
    type(parameters_t), intent(in) :: parameters   !! dimensionless parameters
    call set_force(self, parameters)
    call find_jumps(self%table, felt_jump(parameters))
  end subroutine change_force

  !> The Galilean frame of the flank last touched. Taylor polynomials stand for a series there.
  pure subroutine open_frame(self, instant, frame)
    class(oscillator_t), intent(in) :: self
    type(instant_t), intent(in) :: instant       !! where it opens
    type(frame_t), intent(inout) :: frame        !! its frame
    real(wp) :: g(0:max_degree)
    if (instant%motion_state /= separation .and. self%alike .and. .not. self%harmonic) then
      call open_in_contact(self%table, self%width, instant, frame)
      return
    end if
    if (self%harmonic) then
      call open_on_piece(self%table, 1, instant, frame)
      call expand_series(self%series, instant%t, max_degree, g)
    else
      call open_on_piece(self%table, locate_piece(self%table, instant%t, instant%piece), instant, &
          frame)
      call expand_at(self%table, frame%piece, instant%t, g)
    end if
    call frame_about(g, self%width, self%coast_moves, frame)
  end subroutine open_frame

  !> A step in contact ends at a felt jump of curvature.
  pure subroutine limit_step(self, instant, frame)
    class(oscillator_t), intent(in) :: self
    type(instant_t), intent(in) :: instant       !! where it opens
    type(frame_t), intent(inout) :: frame        !! frame
    if (instant%motion_state == separation .or. self%rigid) return
    frame%stop_knot = self%table%next_felt(frame%piece)
    frame%stop = self%table%knot(frame%stop_knot) - instant%t
  end subroutine limit_step

  !> Between flanks that move alike, off one with a speed, inside one or on the way into it.
  pure logical function begins_clear(self, instant, shortest) result(clear)
    class(oscillator_t), intent(in) :: self
    type(instant_t), intent(in) :: instant       !! where an arc begins
    real(wp), intent(in) :: shortest             !! duration of a chatter that is followed, tau
    real(wp) :: inward, highest
    clear = .false.
    if (.not. self%alike) return
    inward = merge(1.0_wp, -1.0_wp, instant%chart == drive_flank)
    if (instant%motion_state /= separation) then
      clear = .not. self%rigid .and. (instant%touching == instant%chart &
          .or. inward*instant%y(1) > 0)
    else if (instant%touching /= no_flank) then
      clear = instant%touching == instant%chart .and. inward*instant%y(2) < 0
      if (.not. clear .or. self%compliant) return
      ! Half of this would do.
      if (sums_chatter(self, instant%touching)) clear = abs(instant%y(2)) &
          > shortest*self%strongest*(1 - self%restitution)
    else
      highest = merge(0.0_wp, self%width, instant%chart == drive_flank)
      clear = instant%y(1) < highest .and. (instant%y(1) > highest - self%width &
          .or. self%n_flanks == 1)
    end if
  end function begins_clear

  !> g and g'.
  pure subroutine flank_motion(self, t, piece, g, slope)
    class(oscillator_t), intent(in) :: self
    real(wp), intent(in) :: t                    !! time in the cycle
    integer, intent(in) :: piece                 !! table piece to look at first
    real(wp), intent(out) :: g, slope            !! position and velocity
    if (self%harmonic) then
      call series_at(self%series, t, g, slope)
    else
      call flank_motion_at(self%table, t, piece, g, slope)
    end if
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
  pure subroutine stay(self, frame, begin, motion, z_end, y, stays)
    class(oscillator_t), intent(in) :: self
    type(frame_t), intent(in) :: frame           !! frame as opened
    type(instant_t), intent(in) :: begin         !! where the step begins
    type(motion_t), intent(in) :: motion         !! step as a polynomial
    real(wp), intent(in) :: z_end(max_states)    !! local coordinates at its end
    real(wp), intent(inout) :: y(max_states)     !! if it stays: state variables there
    logical, intent(out) :: stays                !! whether it does
    stays = .false.
    if (.not. self%alike) return
    stays = stays_inside(self%table%push(begin%motion_state), begin%motion_state, &
        begin%touching, motion)
    if (stays) y(1:2) = z_end(1:2) - motion%landing
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
    rate(2) = (drive(self%table, self%force, self%damping, &
        frame%chart == drive_flank .or. self%coast_moves, frame, s) - z(1)) - self%damping*z(2)
  end subroutine derivatives

  !> What `stages_by_dispatch` does, for a parabola and a damped spring.
  subroutine stages(self, frame, motion_state, h, z, dense, step)
    class(oscillator_t), intent(in) :: self
    type(frame_t), intent(in) :: frame             !! frame as opened
    integer, intent(in) :: motion_state            !! motion state
    real(wp), intent(in) :: h                      !! step
    real(wp), intent(in) :: z(max_states)          !! local coordinates at s = 0
    logical, intent(in) :: dense                   !! whether the rate at the end is wanted
    type(step_t), intent(inout) :: step            !! the result
    real(wp) :: driven(4)
    if (motion_state == separation) then
      call flight_stages(self%force, h, z, step)
    else
      call drive_over_step(self%table, self%force, self%damping, &
          frame%chart == drive_flank .or. self%coast_moves, frame, h, driven, step%landing)
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
    call distance_in_frame(frame, flank, motion, c)
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

  !> Velocity of a flank at s within the frame's piece.
  pure real(wp) function flank_velocity(self, frame, flank, s)
    class(oscillator_t), intent(in) :: self
    type(frame_t), intent(in) :: frame           !! frame
    integer, intent(in) :: flank                 !! flank
    real(wp), intent(in) :: s                    !! time since it was opened
    flank_velocity = 0
    if (flank == drive_flank .or. self%coast_moves) flank_velocity = frame%origin_rate &
        + horner_slope(frame%flank(:, flank), s - frame%piece_begin)
  end function flank_velocity

  !> phi'+ = -eps phi'-; `absolute`: theta'+ = -eps theta'-.
  pure real(wp) function rebound(self, flank, flank_velocity, approach)
    class(oscillator_t), intent(in) :: self
    integer, intent(in) :: flank                 !! flank struck
    real(wp), intent(in) :: flank_velocity       !! its velocity; 0: it stands still
    real(wp), intent(in) :: approach             !! approach velocity before
    rebound = -self%restitution*approach
    if (.not. self%absolute) return
    rebound = rebound - (1 + self%restitution) &
        *merge(flank_velocity, -flank_velocity, flank == drive_flank)
  end function rebound

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
    y(1:2) = [0.0_wp, merge(approach, -approach, flank == drive_flank)]
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
