!> The oscillator moved in closed form: the same equations, frames and laws, no steps.
module lapwing_flow_exact_exact_oscillator
  use lapwing_kinds, only: wp
  use lapwing_codes, only: separation, no_flank, drive_flank, coast_flank
  use lapwing_flow_exact_interval_bounds, only: blocks_of
  use lapwing_flow_exact_response, only: closed_form, most_panels
  use lapwing_flow_exact_extrema, only: next_turn, farthest
  use lapwing_flow_exact_contact, only: contact_end
  use lapwing_flow_exact_flight, only: end_t, flight_end, bounce, least_width
  use lapwing_flank_series, only: harmonic_series_t, harmonic_series, derivative_series, &
      series_at, bound_derivative
  use lapwing_system_frames, only: frame_about
  use lapwing_system_oscillator, only: oscillator_t, oscillator, open_table_frame
  use lapwing_system_parameters, only: parameters_t
  use lapwing_polynomial_evaluation, only: max_degree
  use lapwing_polynomial_roots, only: first_descent
  use lapwing_flow_exact_slow_contact, only: panel_in_contact
  use lapwing_flow_exact_motion, only: scene_t, curve_t, launch, expand_launch, expand_fully, &
      curve_at, flank_taylor, acceleration_at
  use lapwing_flank_table, only: locate_piece
  use lapwing_system, only: instant_t, frame_t, reached_t, max_states
  implicit none
  private
  public :: exact_oscillator_t, exact_oscillator, begin_curve, walls

  type, extends(oscillator_t) :: exact_oscillator_t
    type(scene_t) :: scene                !! table or series, and what is computed beforehand
    type(scene_t) :: push                 !! `rigid`, series: F - g'' as a motion of its own
    real(wp) :: g_low = 0                 !! lower bound of g
    real(wp) :: bend = 0                  !! bound of |g''|
    real(wp) :: slow = 0                  !! rebounds up to this speed might be below resolution
  contains
    procedure :: change_force
    procedure :: open_frame, flank_motion, stretch, inside, turn, deepest, rigid_release
  end type exact_oscillator_t

contains

  !> Oscillator from its parameters and its transmission error, a table or a series.
  function exact_oscillator(parameters, knots, coefficients, kinks, series) result(self)
    type(parameters_t), intent(in) :: parameters  !! dimensionless parameters
    real(wp), intent(in) :: knots(:)              !! (n + 1) mesh phase, 0 to 1
    real(wp), intent(in) :: coefficients(0:, :)   !! (0:5, n) rad per mesh period**k
    logical, intent(in) :: kinks(:)               !! (n) slope jump at knots(i)
    real(wp), intent(in) :: series(:, :)          !! (3, terms), first order -1: none
    type(exact_oscillator_t) :: self
    type(harmonic_series_t) :: g
    logical :: harmonic
    self%oscillator_t = oscillator(parameters, knots, coefficients, kinks)
    self%closed_form = .true.
    harmonic = series(1, 1) >= 0
    if (harmonic) then
      g = harmonic_series(series, parameters%flank_scale, parameters%mesh_frequency_ratio)
      self%g_low = g%constant - bound_derivative(g, 0)
    else
      self%g_low = lowest(self)
    end if
    self%bend = bend_bound(self, g, harmonic)
    call follow_force(self)
    self%scene%table = self%table
    self%scene%form = closed_form(self%table, g, harmonic, parameters%damping_ratio, self%period, &
        most_panels)
    self%scene%blocks = blocks_of(self%scene%form, self%table)
    if (harmonic .and. self%rigid) then
      self%push%force = 0
      self%push%table = self%table
      self%push%form = closed_form(self%table, derivative_series(g, 2), .true., 0.5_wp, &
          self%period, most_panels)
    end if
  end function exact_oscillator

  !> The same oscillator under another force.
  pure subroutine change_force(self, parameters)
    class(exact_oscillator_t), intent(inout) :: self
    type(parameters_t), intent(in) :: parameters  !! dimensionless parameters
    call self%oscillator_t%change_force(parameters)
    call follow_force(self)
  end subroutine change_force

  !> What hangs on the force.
  pure subroutine follow_force(self)
    class(exact_oscillator_t), intent(inout) :: self
    self%scene%force = self%force
    self%slow = 4*spacing(self%period)*(abs(self%force) + self%bend)
  end subroutine follow_force

  !> Bound of |g''|.
  pure real(wp) function bend_bound(self, g, harmonic) result(bound)
    class(exact_oscillator_t), intent(in) :: self
    type(harmonic_series_t), intent(in) :: g     !! g as a series
    logical, intent(in) :: harmonic              !! whether it is one
    real(wp) :: width, bend
    integer :: i, k
    bound = 0
    if (harmonic) then
      bound = 2*bound_derivative(g, 2)
      return
    end if
    do i = 1, self%table%n
      width = self%table%knot(i + 1) - self%table%knot(i)
      bend = 0
      do k = max_degree, 2, -1
        bend = bend*width + k*(k - 1)*abs(self%table%coefficient(k, i))
      end do
      bound = max(bound, bend)
    end do
  end function bend_bound

  !> Lower bound of g from the sizes of each piece's terms.
  pure real(wp) function lowest(self)
    class(exact_oscillator_t), intent(in) :: self
    real(wp) :: width, spread
    integer :: i, k
    lowest = huge(lowest)
    do i = 1, self%table%n
      width = self%table%knot(i + 1) - self%table%knot(i)
      spread = 0
      do k = max_degree, 1, -1
        spread = (spread + abs(self%table%coefficient(k, i)))*width
      end do
      lowest = min(lowest, self%table%coefficient(0, i) - spread)
    end do
  end function lowest

  !> Frame whose flanks are the series' Taylor polynomials; good at its beginning only, which is
  !> all that a stretch in closed form asks of it.
  pure subroutine open_frame(self, instant, frame, z)
    class(exact_oscillator_t), intent(in) :: self
    type(instant_t), intent(in) :: instant       !! where the stretch begins
    type(frame_t), intent(out) :: frame          !! its frame
    real(wp), intent(out) :: z(max_states)       !! local coordinates of the instant
    real(wp) :: g(0:max_degree)
    if (.not. self%scene%form%harmonic) then
      call open_table_frame(self, instant, frame, z)
      if (.not. self%rigid) then
        frame%stop_knot = self%table%next_kink(frame%piece)
        if (self%scene%form%graded .and. instant%motion_state /= separation) then
          frame%stop_knot = frame%piece + 1
        end if
        frame%stop = self%table%knot(frame%stop_knot) - instant%t
      end if
      return
    end if
    frame%piece = 1
    frame%stop_knot = self%table%n + 1
    frame%stop = self%period - instant%t
    frame%piece_end = frame%stop
    call flank_taylor(self%scene, .true., instant%t, 1, g)
    call frame_about(instant, g, self%width, self%coast_moves, frame)
    z = instant%y
  end subroutine open_frame

  !> g and g'.
  pure subroutine flank_motion(self, t, piece, g, slope)
    class(exact_oscillator_t), intent(in) :: self
    real(wp), intent(in) :: t                    !! time in the cycle
    integer, intent(in) :: piece                 !! table piece to look at first
    real(wp), intent(out) :: g, slope            !! position and velocity
    if (self%scene%form%harmonic) then
      call series_at(self%scene%form%g, t, g, slope)
    else
      call self%oscillator_t%flank_motion(t, piece, g, slope)
    end if
  end subroutine flank_motion

  !> The smooth stretch that begins at an instant.
  pure subroutine stretch(self, instant, stop, reached)
    class(exact_oscillator_t), intent(in) :: self
    type(instant_t), intent(in) :: instant       !! where it begins
    real(wp), intent(in) :: stop                 !! latest end
    type(reached_t), intent(out) :: reached      !! its end
    type(curve_t) :: curve
    type(end_t) :: at
    logical :: standing
    call begin_curve(self, instant, curve)
    standing = self%n_flanks == 2 .and. .not. self%coast_moves
    reached%chart = instant%chart
    if (instant%motion_state /= separation) then
      call contact_end(self%scene, curve, instant%motion_state, &
          instant%touching == instant%motion_state, stop, at)
    else if (standing) then
      call flight_to_standing(self, instant, curve, stop, at, reached%chart)
    else
      call flight_end(self%scene, curve, walls(self, instant%chart), instant%touching, stop, at)
    end if
    reached%s = at%s
    reached%flank = at%flank
    reached%y(1:2) = [at%x, at%v]
    if (at%flank /= no_flank) then
      reached%chart = at%flank
      reached%y(1) = 0
    end if
  end subroutine stretch

  !> The curve of a stretch.
  pure subroutine begin_curve(self, instant, curve)
    class(exact_oscillator_t), intent(in) :: self
    type(instant_t), intent(in) :: instant       !! where the stretch begins
    type(curve_t), intent(inout) :: curve        !! the curve
    integer :: piece
    piece = 1
    if (.not. self%scene%form%harmonic) piece = locate_piece(self%table, instant%t, instant%piece)
    call launch(self%scene, instant%motion_state /= separation, &
        instant%chart == drive_flank .or. self%coast_moves, instant%t, piece, &
        instant%y(1), instant%y(2), curve)
  end subroutine begin_curve

  !> Positions of the two flanks seen from one of them, both moving with g.
  pure function walls(self, chart) result(wall)
    class(exact_oscillator_t), intent(in) :: self
    integer, intent(in) :: chart                 !! flank that positions refer to
    real(wp) :: wall(2)
    wall = [0.0_wp, least_width]
    if (self%n_flanks == 1) return
    wall = [0.0_wp, -self%width]
    if (chart == coast_flank) wall = wall + self%width
  end function walls

  !> End of a flight between the moving drive flank and a standing coast flank.
  pure subroutine flight_to_standing(self, instant, curve, stop, at, chart)
    class(exact_oscillator_t), intent(in) :: self
    type(instant_t), intent(in) :: instant       !! where the flight begins
    type(curve_t), intent(inout) :: curve        !! its curve
    real(wp), intent(in) :: stop                 !! latest end
    type(end_t), intent(out) :: at               !! the end
    integer, intent(out) :: chart                !! flank that the end refers to
    real(wp) :: g, slope, c(0:max_degree), latest, s
    logical :: found
    type(instant_t) :: from_drive
    ! A flight that ends before it can meet the other flank, wherever that is, is told from its own.
    chart = instant%chart
    if (chart == instant%touching) then
      call expand_launch(self%scene, curve)
      call own_bounce(self, curve, chart, stop, found, at)
      if (found) return
    end if
    chart = drive_flank
    call self%flank_motion(instant%t, instant%piece, g, slope)
    c = 0
    c(0:1) = instant%y(1:2)
    c(2) = 0.5_wp*self%force
    from_drive = instant
    if (instant%chart == drive_flank) then
      c(0:1) = c(0:1) + [g + self%width, slope]
    else
      from_drive%chart = drive_flank
      from_drive%y(1:2) = c(0:1) - [g + self%width, slope]
    end if
    if (instant%touching == coast_flank) c(0) = 0
    latest = stop
    call first_descent(c, stop, instant%touching == coast_flank, found, s)
    if (found) latest = s
    call begin_curve(self, from_drive, curve)
    call flight_end(self%scene, curve, [0.0_wp, least_width], &
        merge(drive_flank, no_flank, instant%touching == drive_flank), latest, at)
    if (at%flank /= no_flank .or. .not. found) return
    at%flank = coast_flank
    call self%flank_motion(instant%t + at%s, instant%piece, g, slope)
    at%v = at%v + slope
  end subroutine flight_to_standing

  !> A short flight back to its own flank while the other one is out of reach.
  pure subroutine own_bounce(self, curve, flank, stop, found, at)
    class(exact_oscillator_t), intent(in) :: self
    type(curve_t), intent(in) :: curve           !! its curve
    integer, intent(in) :: flank                 !! flank left
    real(wp), intent(in) :: stop                 !! latest end
    logical, intent(out) :: found                !! whether it is one
    type(end_t), intent(out) :: at               !! the end
    real(wp) :: wall(2)
    wall = [0.0_wp, -self%width - self%g_low]
    if (flank == coast_flank) wall = [self%width + self%g_low, 0.0_wp]
    call bounce(curve, wall, flank, stop, found, at)
  end subroutine own_bounce

  !> Position and velocity relative to the flank a stretch is told from, at s after its beginning.
  pure subroutine inside(self, begin, s, y)
    class(exact_oscillator_t), intent(in) :: self
    type(instant_t), intent(in) :: begin         !! where the stretch begins
    real(wp), intent(in) :: s                    !! time since then
    real(wp), intent(out) :: y(max_states)       !! position and velocity
    type(curve_t) :: curve
    call begin_curve(self, begin, curve)
    call expand_fully(self%scene, curve)
    y = 0
    call curve_at(self%scene, curve, panel_in_contact(self%scene, curve, s), s, y(1), y(2))
  end subroutine inside

  !> The curve of a stretch told from a flank, its series known.
  pure subroutine curve_from(self, begin, flank, curve)
    class(exact_oscillator_t), intent(in) :: self
    type(instant_t), intent(in) :: begin         !! where the stretch begins
    integer, intent(in) :: flank                 !! flank
    type(curve_t), intent(out) :: curve          !! the curve
    type(instant_t) :: told
    real(wp) :: g, slope, sign
    told = begin
    if (begin%chart /= flank) then
      sign = merge(1.0_wp, -1.0_wp, flank == coast_flank)
      told%chart = flank
      told%y(1) = told%y(1) + sign*self%width
      if (.not. self%coast_moves) then
        call self%flank_motion(begin%t, begin%piece, g, slope)
        told%y(1:2) = told%y(1:2) + sign*[g, slope]
      end if
    end if
    call begin_curve(self, told, curve)
    call expand_fully(self%scene, curve)
  end subroutine curve_from

  !> First turn of the distance to a flank after `from`, which is zero or the last turn found.
  pure subroutine turn(self, begin, flank, from, until, found, s, distance, bend)
    class(exact_oscillator_t), intent(in) :: self
    type(instant_t), intent(in) :: begin         !! where the stretch begins
    integer, intent(in) :: flank                 !! flank
    real(wp), intent(in) :: from, until          !! times since then
    logical, intent(out) :: found                !! whether there is one
    real(wp), intent(out) :: s                   !! when
    real(wp), intent(out) :: distance            !! positive in separation, rad
    real(wp), intent(out) :: bend                !! its second derivative
    type(curve_t) :: curve
    real(wp) :: v
    integer :: panel
    call curve_from(self, begin, flank, curve)
    call next_turn(self%scene, curve, from, until, found, s)
    distance = 0
    bend = 0
    if (.not. found) return
    panel = panel_in_contact(self%scene, curve, s)
    call curve_at(self%scene, curve, panel, s, distance, v)
    bend = acceleration_at(self%scene, curve, panel, s, distance, v)
    if (flank == coast_flank) return
    distance = -distance
    bend = -bend
  end subroutine turn

  !> Largest distance from the drive flank, or depth in the coast flank, over a stretch, if it
  !> exceeds `least`.
  pure real(wp) function deepest(self, begin, flank, until, least)
    class(exact_oscillator_t), intent(in) :: self
    type(instant_t), intent(in) :: begin         !! where the stretch begins
    integer, intent(in) :: flank                 !! flank
    real(wp), intent(in) :: until                !! its length
    real(wp), intent(in) :: least                !! value known already, rad
    type(curve_t) :: curve
    call curve_from(self, begin, flank, curve)
    deepest = farthest(self%scene, curve, -1.0_wp, until, least)
  end function deepest

  !> When a tooth in rigid contact would be pulled: F - g'' of a series falls to zero. It is the
  !> flight of a body without force over the flank -g'', seen from there.
  pure subroutine rigid_release(self, instant, stop, answered, found, s)
    class(exact_oscillator_t), intent(in) :: self
    type(instant_t), intent(in) :: instant       !! where the tooth is
    real(wp), intent(in) :: stop                 !! latest end
    logical, intent(out) :: answered             !! whether g is a series
    logical, intent(out) :: found                !! whether it is
    real(wp), intent(out) :: s                   !! when
    type(curve_t) :: curve
    type(end_t) :: at
    real(wp) :: g(0:max_degree), x, v
    integer :: touching
    answered = self%scene%form%harmonic
    found = .false.
    s = stop
    if (.not. answered) return
    call flank_taylor(self%scene, .true., instant%t, 1, g)
    x = self%force - 2*g(2)
    v = -6*g(3)
    touching = no_flank
    if (instant%motion_state == drive_flank) then
      if (x <= 0) touching = coast_flank
      call launch(self%push, .false., .true., instant%t, 1, x, v, curve)
      call flight_end(self%push, curve, [huge(x), 0.0_wp], touching, stop, at)
    else
      if (x >= 0) touching = drive_flank
      call launch(self%push, .false., .true., instant%t, 1, x, v, curve)
      call flight_end(self%push, curve, [0.0_wp, -huge(x)], touching, stop, at)
    end if
    found = at%flank /= no_flank
    s = at%s
  end subroutine rigid_release
end module lapwing_flow_exact_exact_oscillator
