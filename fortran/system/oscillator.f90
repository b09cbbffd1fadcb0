!> The reduced lapping oscillator: theta'' = F in flight, a damped spring in contact, flanks that
!> move with the transmission error. Equations: docs/model.md.
!>
!> Local coordinates are z = (position, velocity) in the Galilean frame that at s = 0 stands and
!> moves with the flank last touched, y = (distance, velocity) relative to that flank. The flank
!> then starts at zero with zero slope, and a bounce of any size keeps its relative precision.
module lapwing_system_oscillator
  use lapwing_kinds, only: wp
  use lapwing_codes, only: separation, no_flank, drive_flank, coast_flank, gap_symmetric, &
      gap_one_flank
  use lapwing_contact_choice, only: choose_law
  use lapwing_flank, only: flank_t
  use lapwing_flank_fixed, only: fixed_flank_t, make_fixed_flank
  use lapwing_flank_series, only: series_flank_t, make_series_flank, harmonic_series_t, &
      harmonic_series
  use lapwing_flank_table, only: te_table_t, make_table
  use lapwing_system_exclusion, only: stays_inside, skip_ahead_on_arc, bound_depth_in_flight
  use lapwing_system_frames, only: open_unseen, open_with_flanks, carry_over, distance_in_frame
  use lapwing_system_parameters, only: parameters_t, natural_angle, felt_jump
  use lapwing_polynomial_evaluation, only: max_degree, horner, horner_slope, taylor_shift
  use lapwing_system_spring_stages, only: drive, stages_in_contact, flight_stages
  use lapwing_system, only: system_t, instant_t, frame_t, motion_t, max_states
  use lapwing_system_step, only: step_t, lengths_t
  implicit none
  private
  public :: oscillator_t, make_oscillator

  type, extends(system_t) :: oscillator_t
    class(flank_t), allocatable :: path   !! g, the motion of the drive flank
    type(harmonic_series_t), allocatable :: series   !! g itself, where path is a table that follows
                                                     !! it: steps in contact need no table
    type(fixed_flank_t), allocatable :: fixed   !! the coast flank, where it does not move with g
    real(wp) :: force = 1                 !! F, rad
    real(wp) :: damping = 0               !! 2 xi
    real(wp) :: width = 1                 !! distance between the flanks, rad
    real(wp) :: angle_scale = 1           !! natural size of angles, rad
    real(wp) :: flight_velocity_scale = 1 !! natural size of velocities in flight
    real(wp) :: chatter_rate(2) = 0       !! by flank: a rebound slower than this times a duration
                                          !! might belong to a chatter that ends within it
  contains
    procedure :: moves, change_force, open_frame, next_piece, derivatives, gap, contact
    procedure :: commit, pressing, place_at_flank, pass_knot, scales, observe
    procedure :: complete_frame
    procedure :: begins_clear, limit_step, flank_velocity, stages, stay, skip_ahead, bound_depth
  end type oscillator_t

contains

  !> Oscillator from its parameters and its transmission error over mesh phase.
  subroutine make_oscillator(parameters, knots, coefficients, kinks, series, self, error)
    type(parameters_t), intent(in) :: parameters  !! dimensionless parameters
    real(wp), intent(in) :: knots(:)              !! (n + 1) mesh phase, 0 to 1; n = 0: no table
    real(wp), intent(in) :: coefficients(0:, :)   !! (0:5, n) rad per mesh period**k
    logical, intent(in) :: kinks(:)               !! (n) slope jump at knots(i)
    real(wp), intent(in) :: series(:, :)          !! (3, terms), first order -1: none; beside a
                                                  !! table: what it follows
    type(oscillator_t), intent(out) :: self       !! oscillator
    integer, intent(out) :: error                 !! 0, or there is no memory for it
    real(wp), parameter :: two_pi = 8*atan(1.0_wp)
    type(te_table_t), allocatable :: table
    type(series_flank_t), allocatable :: smooth
    associate (p => parameters)
      self%n_states = 2
      self%n_flanks = merge(1, 2, p%gap == gap_one_flank)
      self%period = two_pi/p%mesh_frequency_ratio
      call choose_law(p%contact_law, p%impact_law, p%restitution, self%law)
      self%damping = 2*p%damping_ratio
      self%width = merge(2*p%backlash, p%backlash, p%gap == gap_symmetric)
      if (size(kinks) == 0) then
        allocate (smooth)
        call make_series_flank(harmonic_series(series, p%flank_scale, p%mesh_frequency_ratio), &
            self%period, smooth, error)
        call move_alloc(smooth, self%path)
      else
        allocate (table)
        call make_table(knots, coefficients, kinks, p%flank_scale, self%period, felt(self, p), &
            table, error)
        call move_alloc(table, self%path)
        if (error == 0 .and. series(1, 1) >= 0) self%series = harmonic_series(series, &
            p%flank_scale, p%mesh_frequency_ratio)
      end if
      if (error == 0 .and. self%n_flanks == 2 .and. .not. p%back_flank_te) then
        allocate (self%fixed)
        call make_fixed_flank(self%period, self%fixed, error)
      end if
      if (error /= 0) return
      call set_force(self, p)
    end associate
  end subroutine make_oscillator

  !> The force, and the scales that hang on it.
  pure subroutine set_force(self, p)
    class(oscillator_t), intent(inout) :: self
    type(parameters_t), intent(in) :: p      !! dimensionless parameters
    integer :: flank
    self%force = p%force
    self%angle_scale = natural_angle(p)
    self%flight_velocity_scale = self%angle_scale*min(1.0_wp, p%mesh_frequency_ratio)
    self%strongest = abs(p%force) + maxval(abs(self%path%push))
    do flank = drive_flank, coast_flank
      ! Half of this would do.
      self%chatter_rate(flank) = merge(self%strongest*(1 - self%law%restitution), 0.0_wp, &
          self%law%sums_chatter(self%moves(flank)))
    end do
  end subroutine set_force

  !> The same oscillator under another force.
  pure subroutine change_force(self, parameters)
    class(oscillator_t), intent(inout) :: self
    type(parameters_t), intent(in) :: parameters   !! dimensionless parameters
    call set_force(self, parameters)
    call self%path%feel(felt(self, parameters))
  end subroutine change_force

  !> Smallest curvature jump at which a step in contact ends; a rigid one is no step.
  pure real(wp) function felt(self, p)
    class(oscillator_t), intent(in) :: self  !! its law is known
    type(parameters_t), intent(in) :: p      !! dimensionless parameters
    felt = felt_jump(p)
    if (self%law%is_rigid()) felt = huge(felt)
  end function felt

  !> Whether a flank moves with g.
  pure logical function moves(self, flank)
    class(oscillator_t), intent(in) :: self
    integer, intent(in) :: flank
    moves = flank == drive_flank .or. .not. allocated(self%fixed)
  end function moves

  !> The Galilean frame of the flank last touched. The Taylor polynomial of a series is exact at its
  !> beginning alone, where decisions are made; flights and crossings are looked for on tables.
  pure subroutine open_frame(self, instant, frame)
    class(oscillator_t), intent(in) :: self
    type(instant_t), intent(in) :: instant       !! where it opens
    type(frame_t), intent(inout) :: frame        !! its frame
    if (allocated(self%series) .and. instant%motion_state /= separation) then
      call open_unseen(self%path, instant, frame)
    else
      call open_with_flanks(self%path, self%fixed, self%width, instant, frame)
    end if
  end subroutine open_frame

  !> Look up the flanks of a frame that was opened without them.
  pure subroutine complete_frame(self, frame)
    class(oscillator_t), intent(in) :: self
    type(frame_t), intent(inout) :: frame        !! frame as opened
    if (frame%piece == 0) call open_with_flanks(self%path, self%fixed, self%width, &
        instant_t(chart=frame%chart, t=frame%t), frame)
  end subroutine complete_frame

  !> A step in contact ends at a felt jump of curvature.
  pure subroutine limit_step(self, instant, frame)
    class(oscillator_t), intent(in) :: self
    type(instant_t), intent(in) :: instant       !! where it opens
    type(frame_t), intent(inout) :: frame
    if (instant%motion_state == separation .or. frame%piece == 0) return
    frame%stop_knot = self%path%next_felt(frame%piece)
    frame%stop = self%path%knot(frame%stop_knot) - instant%t
  end subroutine limit_step

  !> Between flanks that move together, off one with a speed, inside one or on the way into it.
  pure logical function begins_clear(self, instant, shortest) result(clear)
    class(oscillator_t), intent(in) :: self
    type(instant_t), intent(in) :: instant       !! where an arc begins
    real(wp), intent(in) :: shortest             !! duration of a chatter that is followed, tau
    real(wp) :: inward, highest
    clear = .false.
    if (allocated(self%fixed)) return
    inward = merge(1.0_wp, -1.0_wp, instant%chart == drive_flank)
    if (instant%motion_state /= separation) then
      ! A tooth in rigid contact is at zero.
      clear = inward*instant%y(1) > 0
      if (.not. clear .and. instant%touching == instant%chart) clear = .not. self%law%is_rigid()
    else if (instant%touching /= no_flank) then
      clear = instant%touching == instant%chart .and. -inward*instant%y(2) > &
          shortest*self%chatter_rate(instant%touching)
    else
      highest = merge(0.0_wp, self%width, instant%chart == drive_flank)
      clear = instant%y(1) < highest .and. (instant%y(1) > highest - self%width &
          .or. self%n_flanks == 1)
    end if
  end function begins_clear

  !> Carry position and velocity of the flanks over to the next piece, whose bend takes over.
  pure subroutine next_piece(self, frame)
    class(oscillator_t), intent(in) :: self
    type(frame_t), intent(inout) :: frame        !! frame, moved one piece on
    call carry_over(self%path, [moves(self, drive_flank), moves(self, coast_flank)], frame)
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
    if (.not. allocated(self%fixed)) stays = stays_inside( &
        self%path%push(begin%motion_state), begin%motion_state, begin%touching, motion)
    if (stays) y(1:2) = z_end(1:2) - motion%landing
  end subroutine stay

  !> Up to the piece on which a flank might be met or left. Left to the search of every piece: a
  !> coast flank that does not move with the drive flank.
  pure subroutine skip_ahead(self, motion_state, motion, frame, touching, clear)
    class(oscillator_t), intent(in) :: self
    integer, intent(in) :: motion_state
    type(motion_t), intent(in) :: motion         !! step as a polynomial
    type(frame_t), intent(inout) :: frame        !! frame, on the piece to be searched next
    integer, intent(inout) :: touching           !! flank at zero distance where it begins, or none
    logical, intent(out) :: clear                !! whether nothing is met up to the step's end
    clear = .false.
    if (.not. allocated(self%fixed)) call skip_ahead_on_arc(self%path, &
        self%width, self%n_flanks, motion_state, self%force, motion, frame, touching, clear)
  end subroutine skip_ahead

  !> The same for the largest distance from the drive flank.
  pure subroutine bound_depth(self, motion, length, frame, floor, until)
    class(oscillator_t), intent(in) :: self
    type(motion_t), intent(in) :: motion         !! step as a polynomial
    real(wp), intent(in) :: length               !! how much of it counts
    type(frame_t), intent(in) :: frame           !! frame, as opened or at a piece's beginning
    real(wp), intent(inout) :: floor             !! distance that is exceeded, perhaps raised
    real(wp), intent(out) :: until               !! time up to which it is not
    until = 0
    if (.not. allocated(self%fixed)) call bound_depth_in_flight(self%path, self%width, &
        self%force, motion, length, frame, floor, until)
  end subroutine bound_depth

  !> Flight under the constant force, or the damped spring of the flank in contact.
  pure subroutine derivatives(self, frame, motion_state, s, z, rate)
    class(oscillator_t), intent(in) :: self
    type(frame_t), intent(in) :: frame           !! frame as opened
    integer, intent(in) :: motion_state
    real(wp), intent(in) :: s                    !! time since the frame was opened
    real(wp), intent(in) :: z(:)                 !! position and velocity
    real(wp), intent(out) :: rate(:)             !! velocity and acceleration
    rate(1) = z(2)
    rate(2) = self%force
    if (motion_state == separation) return
    if (moves(self, frame%chart)) rate(2) = rate(2) + drive(self%path, self%series, &
        self%damping, frame, s)
    rate(2) = (rate(2) - z(1)) - self%damping*z(2)
  end subroutine derivatives

  !> The stages of a step for a parabola and a damped spring.
  subroutine stages(self, frame, motion_state, h, z, lengths, step, done)
    class(oscillator_t), intent(in) :: self
    type(frame_t), intent(in) :: frame             !! frame as opened
    integer, intent(in) :: motion_state
    real(wp), intent(in) :: h                      !! step
    real(wp), intent(in) :: z(max_states)          !! local coordinates at s = 0
    type(lengths_t), intent(inout), optional :: lengths   !! what steps of one length share;
                                                          !! absent: it will not come again
    type(step_t), intent(inout) :: step            !! the result
    logical, intent(out) :: done                   !! always
    done = .true.
    if (motion_state == separation) then
      call flight_stages(self%force, h, z, step)
    else
      call stages_in_contact(self%path, self%series, self%damping, self%force, &
          moves(self, frame%chart), frame, h, z(1:2), lengths, step)
    end if
  end subroutine stages

  !> Distance to a flank over the frame's piece.
  pure subroutine gap(self, frame, flank, motion, c)
    class(oscillator_t), intent(in) :: self
    type(frame_t), intent(in) :: frame
    integer, intent(in) :: flank                 !! drive_flank or coast_flank
    type(motion_t), intent(in) :: motion         !! step as a polynomial
    real(wp), intent(out) :: c(0:max_degree)     !! coefficients in s - piece_begin
    call distance_in_frame(frame, flank, motion, c)
  end subroutine gap

  !> Distance and approach velocity to a flank at s within the frame's piece.
  pure subroutine contact(self, frame, flank, s, z, distance, approach)
    class(oscillator_t), intent(in) :: self
    type(frame_t), intent(in) :: frame
    integer, intent(in) :: flank
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
    type(frame_t), intent(in) :: frame
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
    type(frame_t), intent(in) :: frame
    integer, intent(in) :: flank
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
    type(frame_t), intent(in) :: frame
    integer, intent(in) :: flank
    real(wp), intent(in) :: s                    !! time since it was opened
    flank_velocity = 0
    if (moves(self, flank)) flank_velocity = frame%origin_rate &
        + horner_slope(frame%flank(:, flank), s - frame%piece_begin)
  end function flank_velocity

  !> On the flank, with the given approach velocity.
  pure subroutine place_at_flank(self, flank, approach, y)
    class(oscillator_t), intent(in) :: self
    integer, intent(in) :: flank                 !! flank the chart refers to
    real(wp), intent(in) :: approach             !! approach velocity, negative: leaves
    real(wp), intent(inout) :: y(max_states)     !! state variables in the flank's chart
    y(1:2) = [0.0_wp, merge(approach, -approach, flank == drive_flank)]
  end subroutine place_at_flank

  !> Through a kink theta and theta' are continuous: phi' loses what g' gains.
  pure subroutine pass_knot(self, knot, instant, is_kink, jump)
    class(oscillator_t), intent(in) :: self
    integer, intent(in) :: knot                  !! knot reached
    type(instant_t), intent(inout) :: instant    !! state before, then after
    logical, intent(out) :: is_kink              !! whether the flank's slope jumps here
    real(wp), intent(out) :: jump                !! added to phi'
    if (knot > self%path%n) then
      instant%cycle = instant%cycle + 1
      instant%t = 0
      instant%piece = 1
    else
      instant%t = self%path%knot(knot)
      instant%piece = knot
    end if
    is_kink = self%path%kink(knot)
    jump = -self%path%slope_jump(knot)
    if (moves(self, instant%chart)) instant%y(2) = instant%y(2) + jump
  end subroutine pass_knot

  !> Angles by the smallest of backlash and motion; velocities by that per unit of tau, or per
  !> mesh radian in flight where that is slower.
  pure subroutine scales(self, motion_state, scale)
    class(oscillator_t), intent(in) :: self
    integer, intent(in) :: motion_state
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
    if (.not. allocated(self%fixed)) return
    call self%path%motion(instant%t, instant%piece, g, slope)
    phi = phi - g
    phi_dot = phi_dot - slope
  end subroutine observe
end module lapwing_system_oscillator
