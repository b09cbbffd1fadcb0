!> Motion in closed form, of an oscillator that is linear in each motion state: no steps.
module lapwing_flow_exact_exact_flow
  use lapwing_kinds, only: wp
  use lapwing_codes, only: separation, no_flank, drive_flank, coast_flank, status_ok
  use lapwing_flank_series, only: harmonic_series_t, derivative_series, bound_derivative
  use lapwing_flank_table, only: lower_bound, locate_piece
  use lapwing_flow, only: flow_t, arc_t, reached_t, work_t, step_memory_t, listener_t, &
      instant_on, at_stop
  use lapwing_flow_exact_contact, only: contact_end
  use lapwing_flow_exact_extrema, only: next_turn, farthest_of => farthest
  use lapwing_flow_exact_flight, only: end_t, flight_end, bounce, least_width
  use lapwing_flow_exact_interval_bounds, only: make_blocks
  use lapwing_flow_exact_motion, only: scene_t, curve_t, launch, expand_launch, expand_fully, &
      curve_at, flank_taylor, acceleration_at
  use lapwing_flow_exact_response, only: make_closed_form, most_panels
  use lapwing_flow_exact_slow_contact, only: panel_in_contact
  use lapwing_polynomial_evaluation, only: max_degree
  use lapwing_polynomial_roots, only: first_descent
  use lapwing_system, only: system_t, instant_t, frame_t, max_states
  use lapwing_system_frames, only: open_on_piece
  use lapwing_system_oscillator, only: oscillator_t
  implicit none
  private
  public :: exact_flow_t, make_exact_flow

  type, extends(flow_t) :: exact_flow_t
    type(scene_t) :: scene                !! table or series, and what is computed beforehand
    type(scene_t) :: push                 !! `rigid`, series: F - g'' as a motion of its own
    real(wp) :: g_low = 0                 !! lower bound of g
    type(oscillator_t), pointer :: of => null()   !! the oscillator that moves
  contains
    procedure :: open, advance, state_at, farthest, near_turns, rigid_release, change_force
  end type exact_flow_t

contains

  !> What an oscillator's motion needs in closed form.
  subroutine make_exact_flow(system, self, error)
    type(oscillator_t), intent(in), target :: system   !! oscillator, which must outlive the flow
    type(exact_flow_t), intent(out) :: self            !! the flow
    integer, intent(out) :: error                      !! 0, or there is no memory for it
    self%takes_steps = .false.
    self%of => system
    call make_scene(system, system%series, 0.5_wp*system%damping, self%scene, error)
    if (error /= 0) return
    self%scene%force = system%force
    call make_blocks(self%scene%form, system%table, self%scene%blocks, error)
    if (error /= 0) return
    if (.not. system%harmonic) then
      self%g_low = lower_bound(system%table)
      return
    end if
    self%g_low = system%series%constant - bound_derivative(system%series, 0)
    if (.not. system%rigid) return
    call make_scene(system, derivative_series(system%series, 2), 0.5_wp, self%push, error)
    self%push%force = 0
  end subroutine make_exact_flow

  subroutine make_scene(system, series, xi, scene, error)
    type(oscillator_t), intent(in), target :: system   !! oscillator
    type(harmonic_series_t), intent(in) :: series      !! motion of the flank, if it is one
    real(wp), intent(in) :: xi                         !! damping ratio
    type(scene_t), intent(out) :: scene                !! table or series, and its closed form
    integer, intent(out) :: error                      !! 0, or there is no memory for it
    scene%table => system%table
    call make_closed_form(system%table, series, system%harmonic, xi, system%period, most_panels, &
        scene%form, error)
  end subroutine make_scene

  !> The same under another force.
  subroutine change_force(self, force)
    class(exact_flow_t), intent(inout) :: self
    real(wp), intent(in) :: force                 !! F
    self%scene%force = force
  end subroutine change_force

  !> The system's frame.
  subroutine open(self, system, instant, frame)
    class(exact_flow_t), intent(in) :: self
    class(system_t), intent(in) :: system        !! what moves
    type(instant_t), intent(in) :: instant       !! where the arc begins
    type(frame_t), intent(inout) :: frame        !! its frame
    call system%open_frame(instant, frame)
    if (self%scene%form%graded) call stop_at_knot(self, instant, frame)
  end subroutine open

  !> What an arc needs of a frame where nobody looks at the flanks in it: its stop.
  pure subroutine open_no_flanks(self, instant, frame)
    class(exact_flow_t), intent(in) :: self
    type(instant_t), intent(in) :: instant       !! where the arc begins
    type(frame_t), intent(inout) :: frame        !! its frame
    call open_on_piece(self%scene%table, piece_of(self, instant), instant, frame)
    if (self%scene%form%graded) call stop_at_knot(self, instant, frame)
  end subroutine open_no_flanks

  !> In a graded scene a contact stops at each knot of a table.
  pure subroutine stop_at_knot(self, instant, frame)
    class(exact_flow_t), intent(in) :: self
    type(instant_t), intent(in) :: instant       !! where the arc begins
    type(frame_t), intent(inout) :: frame        !! its frame
    if (self%scene%form%harmonic .or. instant%motion_state == separation) return
    frame%stop_knot = frame%piece + 1
    frame%stop = self%scene%table%knot(frame%stop_knot) - instant%t
  end subroutine stop_at_knot

  !> Table piece that holds an instant; of a series there is one.
  pure integer function piece_of(self, instant) result(piece)
    class(exact_flow_t), intent(in) :: self
    type(instant_t), intent(in) :: instant       !! instant
    piece = 1
    if (.not. self%scene%form%harmonic) piece = locate_piece(self%scene%table, instant%t, &
        instant%piece)
  end function piece_of

  !> Follow an arc to the first guard or its stop; in a graded scene it may end before, of nothing.
  subroutine advance(self, system, tolerance, opened, arc, memory, reached, work, status)
    class(exact_flow_t), intent(in) :: self
    class(system_t), intent(in) :: system         !! what moves
    real(wp), intent(in) :: tolerance             !! without effect
    logical, intent(in) :: opened                 !! whether the arc's frame is
    type(arc_t), intent(inout) :: arc             !! the arc
    type(step_memory_t), intent(inout) :: memory(0:)   !! without effect
    type(reached_t), intent(inout) :: reached     !! its end
    type(work_t), intent(inout) :: work           !! counts
    integer, intent(out) :: status                !! status_ok
    type(curve_t) :: curve
    type(end_t) :: at
    status = status_ok
    work%stretches = work%stretches + 1
    if (.not. opened) call open_no_flanks(self, arc%begin, arc%frame)
    associate (begin => arc%begin)
      call begin_curve(self, begin, arc%frame%piece, curve)
      reached%chart = begin%chart
      if (begin%motion_state /= separation) then
        call contact_end(self%scene, curve, begin%motion_state, &
            begin%touching == begin%motion_state, arc%frame%stop, at)
      else if (self%of%n_flanks == 2 .and. .not. self%of%coast_moves) then
        call flight_to_standing(self, begin, curve, arc%frame%stop, at, reached%chart)
      else
        call flight_end(self%scene, curve, walls(self, begin%chart), begin%touching, &
            arc%frame%stop, at)
      end if
    end associate
    reached%flank = at%flank
    reached%s = at%s
    reached%piece = arc%frame%piece
    reached%y(1:2) = [at%x, at%v]
    if (at%flank == no_flank) return
    reached%chart = at%flank
    reached%y(1) = 0
    if (at_stop(arc%frame, at%s)) then
      reached%flank = no_flank
      reached%s = arc%frame%stop
    else if (system%absolute) then
      reached%flank_velocity = velocity_of(self, at%flank, arc%begin%t + at%s, arc%frame%piece)
    end if
  end subroutine advance

  !> Velocity of a flank.
  pure real(wp) function velocity_of(self, flank, t, guess) result(velocity)
    class(exact_flow_t), intent(in) :: self
    integer, intent(in) :: flank                 !! flank
    real(wp), intent(in) :: t                    !! time in the cycle
    integer, intent(in) :: guess                 !! table piece to look at first
    real(wp) :: g(0:max_degree)
    integer :: piece
    velocity = 0
    if (flank == coast_flank .and. .not. self%of%coast_moves) return
    piece = 1
    if (.not. self%scene%form%harmonic) piece = locate_piece(self%scene%table, t, guess)
    call flank_taylor(self%scene, .true., t, piece, g)
    velocity = g(1)
  end function velocity_of

  !> The curve of an arc.
  pure subroutine begin_curve(self, instant, piece, curve)
    class(exact_flow_t), intent(in) :: self
    type(instant_t), intent(in) :: instant       !! where the arc begins
    integer, intent(in) :: piece                 !! table piece that holds it
    type(curve_t), intent(inout) :: curve        !! the curve
    call launch(self%scene, instant%motion_state /= separation, &
        instant%chart == drive_flank .or. self%of%coast_moves, instant%t, piece, &
        instant%y(1), instant%y(2), curve)
  end subroutine begin_curve

  !> Positions of the two flanks seen from one of them, both moving with g.
  pure function walls(self, chart) result(wall)
    class(exact_flow_t), intent(in) :: self
    integer, intent(in) :: chart                 !! flank that positions refer to
    real(wp) :: wall(2)
    wall = [0.0_wp, least_width]
    if (self%of%n_flanks == 1) return
    wall = [0.0_wp, -self%of%width]
    if (chart == coast_flank) wall = wall + self%of%width
  end function walls

  !> End of a flight between the moving drive flank and a standing coast flank.
  pure subroutine flight_to_standing(self, instant, curve, stop, at, chart)
    class(exact_flow_t), intent(in) :: self
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
    call self%of%flank_motion(instant%t, instant%piece, g, slope)
    c = 0
    c(0:1) = instant%y(1:2)
    c(2) = 0.5_wp*self%scene%force
    from_drive = instant
    if (instant%chart == drive_flank) then
      c(0:1) = c(0:1) + [g + self%of%width, slope]
    else
      from_drive%chart = drive_flank
      from_drive%y(1:2) = c(0:1) - [g + self%of%width, slope]
    end if
    if (instant%touching == coast_flank) c(0) = 0
    latest = stop
    call first_descent(c, stop, instant%touching == coast_flank, found, s)
    if (found) latest = s
    call begin_curve(self, from_drive, piece_of(self, from_drive), curve)
    call flight_end(self%scene, curve, [0.0_wp, least_width], &
        merge(drive_flank, no_flank, instant%touching == drive_flank), latest, at)
    if (at%flank /= no_flank .or. .not. found) return
    at%flank = coast_flank
    call self%of%flank_motion(instant%t + at%s, instant%piece, g, slope)
    at%v = at%v + slope
  end subroutine flight_to_standing

  !> A short flight back to its own flank while the other one is out of reach.
  pure subroutine own_bounce(self, curve, flank, stop, found, at)
    class(exact_flow_t), intent(in) :: self
    type(curve_t), intent(in) :: curve           !! its curve
    integer, intent(in) :: flank                 !! flank left
    real(wp), intent(in) :: stop                 !! latest end
    logical, intent(out) :: found                !! whether it is one
    type(end_t), intent(out) :: at               !! the end
    real(wp) :: wall(2)
    wall = [0.0_wp, -self%of%width - self%g_low]
    if (flank == coast_flank) wall = [self%of%width + self%g_low, 0.0_wp]
    call bounce(curve, wall, flank, stop, found, at)
  end subroutine own_bounce

  !> Position and velocity relative to the flank of an arc's chart.
  subroutine state_at(self, system, arc, s, frame, y)
    class(exact_flow_t), intent(in) :: self
    class(system_t), intent(in) :: system        !! what moves
    type(arc_t), intent(in) :: arc               !! an arc it moved along
    real(wp), intent(in) :: s                    !! time since it began
    type(frame_t), intent(inout) :: frame        !! without effect
    real(wp), intent(out) :: y(max_states)       !! position and velocity
    type(curve_t) :: curve
    call begin_curve(self, arc%begin, piece_of(self, arc%begin), curve)
    call expand_fully(self%scene, curve)
    y = 0
    call curve_at(self%scene, curve, panel_in_contact(self%scene, curve, s), s, y(1), y(2))
  end subroutine state_at

  !> The curve of a arc told from a flank, its series known.
  pure subroutine curve_from(self, begin, flank, curve)
    class(exact_flow_t), intent(in) :: self
    type(instant_t), intent(in) :: begin         !! where the arc begins
    integer, intent(in) :: flank                 !! flank
    type(curve_t), intent(out) :: curve          !! the curve
    type(instant_t) :: told
    real(wp) :: g, slope, sign
    told = begin
    if (begin%chart /= flank) then
      sign = merge(1.0_wp, -1.0_wp, flank == coast_flank)
      told%chart = flank
      told%y(1) = told%y(1) + sign*self%of%width
      if (.not. self%of%coast_moves) then
        call self%of%flank_motion(begin%t, begin%piece, g, slope)
        told%y(1:2) = told%y(1:2) + sign*[g, slope]
      end if
    end if
    call begin_curve(self, told, piece_of(self, told), curve)
    call expand_fully(self%scene, curve)
  end subroutine curve_from

  !> Tell where an arc comes near a flank, or near release, and turns back.
  subroutine near_turns(self, system, arc, within, listener, work)
    class(exact_flow_t), intent(in) :: self
    class(system_t), intent(in) :: system         !! what moves
    type(arc_t), intent(in) :: arc                !! an arc it moved along
    real(wp), intent(in) :: within                !! what is near, rad
    class(listener_t), intent(inout) :: listener  !! who is told
    type(work_t), intent(inout) :: work           !! counts
    type(curve_t) :: curve
    type(instant_t) :: instant
    type(frame_t) :: frame
    real(wp) :: from, s, distance, bend, inward
    integer :: flank
    logical :: found
    frame = arc%frame
    do flank = drive_flank, self%of%n_flanks
      if (arc%begin%motion_state /= separation .and. arc%begin%motion_state /= flank) cycle
      work%graze_searches = work%graze_searches + 1
      inward = merge(1.0_wp, -1.0_wp, arc%begin%motion_state == separation)
      call curve_from(self, arc%begin, flank, curve)
      from = 0
      do
        call next_turn(self%scene, curve, from, arc%length, found, s)
        if (.not. found) exit
        call distance_at(self, curve, flank, s, distance, bend)
        distance = inward*distance
        if (distance > 0 .and. distance <= within .and. inward*bend > 0) then
          call instant_on(self, system, arc, s, frame, instant)
          call listener%hear(flank, instant)
        end if
        from = s
      end do
    end do
  end subroutine near_turns

  !> Distance from a flank and its second derivative at a time of an arc.
  pure subroutine distance_at(self, curve, flank, s, distance, bend)
    class(exact_flow_t), intent(in) :: self
    type(curve_t), intent(in) :: curve           !! the arc, told from the flank
    integer, intent(in) :: flank                 !! flank
    real(wp), intent(in) :: s                    !! time since it began
    real(wp), intent(out) :: distance            !! positive in separation, rad
    real(wp), intent(out) :: bend                !! its second derivative
    real(wp) :: v
    integer :: panel
    panel = panel_in_contact(self%scene, curve, s)
    call curve_at(self%scene, curve, panel, s, distance, v)
    bend = acceleration_at(self%scene, curve, panel, s, distance, v)
    if (flank == coast_flank) return
    distance = -distance
    bend = -bend
  end subroutine distance_at

  !> Largest distance from the drive flank, or depth in the coast flank.
  subroutine farthest(self, system, arc, flank, least, largest, work)
    class(exact_flow_t), intent(in) :: self
    class(system_t), intent(in) :: system        !! what moves
    type(arc_t), intent(in) :: arc               !! an arc it moved along
    integer, intent(in) :: flank                 !! flank
    real(wp), intent(in) :: least                !! value known already, rad
    real(wp), intent(out) :: largest             !! the larger of the two, rad
    type(work_t), intent(inout) :: work          !! counts
    type(curve_t) :: curve
    work%depth_searches = work%depth_searches + 1
    call curve_from(self, arc%begin, flank, curve)
    largest = farthest_of(self%scene, curve, -1.0_wp, arc%length, least)
  end subroutine farthest

  !> When a tooth in rigid contact would be pulled: F - g'' of a series falls to zero. It is the
  !> flight of a body without force over the flank -g'', seen from there.
  subroutine rigid_release(self, system, instant, stop, known, found, s)
    class(exact_flow_t), intent(in) :: self
    class(system_t), intent(in) :: system        !! what moves
    type(instant_t), intent(in) :: instant       !! where the tooth is
    real(wp), intent(in) :: stop                 !! latest end
    logical, intent(out) :: known                !! whether g is a series
    logical, intent(out) :: found                !! whether it is
    real(wp), intent(out) :: s                   !! when
    type(curve_t) :: curve
    type(end_t) :: at
    real(wp) :: g(0:max_degree), x, v
    integer :: touching
    known = self%scene%form%harmonic
    found = .false.
    s = stop
    if (.not. known) return
    call flank_taylor(self%scene, .true., instant%t, 1, g)
    x = self%scene%force - 2*g(2)
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
end module lapwing_flow_exact_exact_flow
