!> Motion in closed form, of an oscillator that is linear in each motion state: no steps.
module lapwing_flow_exact_exact_flow
  use lapwing_kinds, only: wp
  use lapwing_codes, only: separation, no_flank, drive_flank, coast_flank, status_ok
  use lapwing_flank, only: flank_t, locate_piece
  use lapwing_flank_series, only: series_flank_t, make_series_flank, derivative_series
  use lapwing_flow, only: flow_t, arc_t, reached_t, work_t, step_memory_t, listener_t, &
      instant_on, at_stop
  use lapwing_flow_exact_contact, only: contact_end, rigid_contact_end
  use lapwing_flow_exact_extrema, only: next_near_turn, farthest_of => farthest
  use lapwing_flow_exact_flight, only: end_t, flight_end, bounce, least_width
  use lapwing_flow_exact_interval_bounds, only: make_blocks
  use lapwing_flow_exact_curve, only: scene_t, curve_t, begin_curve, expand_start, expand_fully, &
      expand_over, is_smooth
  use lapwing_flow_exact_motion, only: curve_at
  use lapwing_flow_exact_panels, only: most_panels
  use lapwing_flow_exact_piecewise_flights, only: find_bends, flight_over_parabolas, &
      farthest_over_parabolas
  use lapwing_flow_exact_response, only: make_closed_form, make_form_at_rest
  use lapwing_flow_exact_slow_contact, only: panel_in_contact
  use lapwing_polynomial_evaluation, only: max_degree
  use lapwing_polynomial_roots, only: first_descent
  use lapwing_system, only: system_t, instant_t, frame_t, max_states
  use lapwing_system_frames, only: open_on_piece
  use lapwing_system_oscillator, only: oscillator_t
  implicit none
  private
  public :: exact_flow_t, make_exact_flow

  !> Scenes: seen from a flank that moves with g, from a coast flank that does not.
  integer, parameter :: on_moving = 1, on_fixed = 2

  type, extends(flow_t) :: exact_flow_t
    type(scene_t) :: scene(on_moving:on_fixed)       !! seen from a flank
    type(series_flank_t), allocatable :: curvature   !! rigid contact with a series: -g''
    type(scene_t) :: push                 !! and F - g'' as a motion of its own
    real(wp) :: g_low = 0                 !! lower bound of g
    type(oscillator_t), pointer :: of => null()   !! the oscillator that moves
  contains
    procedure :: open, advance, state_at, farthest, near_turns, rigid_release, change_force
  end type exact_flow_t

contains

  !> What an oscillator's motion needs in closed form.
  subroutine make_exact_flow(system, self, error)
    type(oscillator_t), intent(in), target :: system   !! oscillator, which must outlive the flow
    type(exact_flow_t), intent(out), target :: self    !! the flow
    integer, intent(out) :: error                      !! 0, or there is no memory for it
    self%takes_steps = .false.
    self%of => system
    self%g_low = system%path%lower_bound()
    call make_scene(system%path, 0.5_wp*system%damping, system%period, self%scene(on_moving), error)
    if (error == 0 .and. .not. allocated(system%fixed)) then
      call find_bends(self%scene(on_moving), error)
    end if
    if (error == 0 .and. allocated(system%fixed)) then
      associate (still => self%scene(on_fixed))
        still%flank => system%fixed
        call make_form_at_rest(self%scene(on_moving)%form, still%form, error)
        if (error == 0) call make_blocks(still%form, system%fixed, still%blocks, error)
      end associate
    end if
    if (error /= 0) return
    call change_force(self, system%force)
    if (.not. system%law%is_rigid()) return
    select type (path => system%path)
    type is (series_flank_t)
      allocate (self%curvature)
      call make_series_flank(derivative_series(path%series, 2), system%period, self%curvature, &
          error)
      if (error == 0) call make_scene(self%curvature, 0.5_wp, system%period, self%push, error)
      self%push%force = 0
    end select
  end subroutine make_exact_flow

  subroutine make_scene(flank, xi, period, scene, error)
    class(flank_t), intent(in), target :: flank        !! motion of the flank
    real(wp), intent(in) :: xi                         !! damping ratio
    real(wp), intent(in) :: period                     !! mesh period
    type(scene_t), intent(out) :: scene                !! its closed form
    integer, intent(out) :: error                      !! 0, or there is no memory for it
    scene%flank => flank
    call make_closed_form(flank, xi, period, most_panels, scene%form, error)
    if (error == 0) call make_blocks(scene%form, flank, scene%blocks, error)
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
    if (self%scene(on_moving)%form%graded) call stop_at_knot(self, instant, frame)
  end subroutine open

  !> What an arc needs of a frame where nobody looks at the flanks in it: its stop.
  pure subroutine open_no_flanks(self, instant, frame)
    class(exact_flow_t), intent(in) :: self
    type(instant_t), intent(in) :: instant       !! where the arc begins
    type(frame_t), intent(inout) :: frame        !! its frame
    call open_on_piece(self%of%path, locate_piece(self%of%path, instant%t, instant%piece), &
        instant, frame)
    if (self%scene(on_moving)%form%graded) call stop_at_knot(self, instant, frame)
  end subroutine open_no_flanks

  !> In a graded scene a contact stops at each knot of the flank.
  pure subroutine stop_at_knot(self, instant, frame)
    class(exact_flow_t), intent(in) :: self
    type(instant_t), intent(in) :: instant       !! where the arc begins
    type(frame_t), intent(inout) :: frame        !! its frame
    if (instant%motion_state == separation) return
    frame%stop_knot = frame%piece + 1
    frame%stop = self%scene(on_moving)%flank%knot(frame%stop_knot) - instant%t
  end subroutine stop_at_knot

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
    type(end_t) :: at
    status = status_ok
    work%arcs = work%arcs + 1
    if (.not. opened) call open_no_flanks(self, arc%begin, arc%frame)
    reached%chart = arc%begin%chart
    if (arc%begin%motion_state == separation .and. allocated(self%scene(on_moving)%bend)) then
      call flight_over_parabolas(self%scene(on_moving), arc%begin, arc%frame%piece, &
          walls(self, reached%chart), arc%frame%stop, at)
    else
      call end_of_curve(self, arc%begin, arc%frame, arc%curve, at, reached%chart)
    end if
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
    else if (system%law%asks_flank_velocity()) then
      reached%flank_velocity = velocity_of(self, at%flank, arc%begin%t + at%s, arc%frame%piece)
    end if
  end subroutine advance

  !> The end of an arc that takes a curve.
  subroutine end_of_curve(self, begin, frame, curve, at, chart)
    class(exact_flow_t), intent(in) :: self
    type(instant_t), intent(in) :: begin         !! where it begins
    type(frame_t), intent(in) :: frame           !! its frame
    type(curve_t), intent(inout) :: curve        !! the curve
    type(end_t), intent(out) :: at               !! the end
    integer, intent(inout) :: chart              !! flank that positions refer to; then the end's
    call curve_of_arc(self, begin, chart, frame%piece, curve)
    if (begin%motion_state /= separation) then
      call contact_end(self%scene(view(self, chart)), curve, begin%motion_state, &
          begin%touching == begin%motion_state, frame%stop, at)
    else if (allocated(self%of%fixed)) then
      call flight_to_standing(self, begin, curve, frame%stop, at, chart)
    else
      call flight_end(self%scene(on_moving), curve, walls(self, chart), begin%touching, &
          frame%stop, at)
    end if
  end subroutine end_of_curve

  !> Velocity of a flank.
  pure real(wp) function velocity_of(self, flank, t, guess) result(velocity)
    class(exact_flow_t), intent(in) :: self
    integer, intent(in) :: flank
    real(wp), intent(in) :: t                    !! time in the cycle
    integer, intent(in) :: guess                 !! table piece to look at first
    real(wp) :: g(0:max_degree)
    associate (path => self%scene(view(self, flank))%flank)
      call path%taylor(locate_piece(path, t, guess), t, g)
    end associate
    velocity = g(1)
  end function velocity_of

  !> Which scene is seen from a flank.
  pure integer function view(self, flank)
    class(exact_flow_t), intent(in) :: self
    integer, intent(in) :: flank
    view = merge(on_fixed, on_moving, flank == coast_flank .and. allocated(self%of%fixed))
  end function view

  !> The curve of an arc seen from a flank.
  pure subroutine curve_of_arc(self, instant, flank, piece, curve)
    class(exact_flow_t), intent(in) :: self
    type(instant_t), intent(in) :: instant       !! where the arc begins
    integer, intent(in) :: flank
    integer, intent(in) :: piece                 !! piece of the flank, where to look first
    type(curve_t), intent(inout) :: curve        !! the curve
    real(wp) :: y(2)
    y = state_from(self, instant, flank)
    associate (scene => self%scene(view(self, flank)))
      call begin_curve(scene, instant%motion_state /= separation, instant%t, &
          locate_piece(scene%flank, instant%t, piece), y(1), y(2), curve)
    end associate
  end subroutine curve_of_arc

  !> The curve of an arc seen from a flank: the one it was followed by, if that begins with it.
  pure subroutine curve_of(self, arc, flank, curve)
    class(exact_flow_t), intent(in) :: self
    type(arc_t), intent(in) :: arc               !! an arc it moved along
    integer, intent(in) :: flank
    type(curve_t), intent(out) :: curve          !! the curve
    real(wp) :: y(2)
    associate (begin => arc%begin, last => arc%curve)
      if (last%near < 0 .or. allocated(self%of%fixed) .or. last%t /= begin%t .or. &
          last%x /= begin%y(1) .or. last%v /= begin%y(2) .or. last%contact .or. &
          begin%motion_state /= separation) then
        call curve_of_arc(self, begin, flank, begin%piece, curve)
        return
      end if
      curve = last
      if (flank == begin%chart) return
      y = state_from(self, begin, flank)
      curve%x = y(1)
      curve%taylor(0) = y(1)
    end associate
  end subroutine curve_of

  !> Positions of the two flanks seen from one of them, both moving with g.
  pure function walls(self, chart) result(wall)
    class(exact_flow_t), intent(in) :: self
    integer, intent(in) :: chart                 !! flank that positions refer to
    real(wp) :: wall(2)
    wall = [0.0_wp, merge(-self%of%width, least_width, self%of%n_flanks == 2)]
    if (chart == coast_flank) wall = wall - wall(2)
  end function walls

  !> End of a flight between the moving drive flank and a standing coast flank.
  pure subroutine flight_to_standing(self, instant, curve, stop, at, chart)
    class(exact_flow_t), intent(in) :: self
    type(instant_t), intent(in) :: instant       !! where the flight begins
    type(curve_t), intent(inout) :: curve        !! its curve
    real(wp), intent(in) :: stop                 !! latest end
    type(end_t), intent(out) :: at               !! the end
    integer, intent(out) :: chart                !! flank that the end refers to
    real(wp) :: g, slope, c(0:max_degree), wall(2), latest, s
    logical :: found
    type(instant_t) :: from_drive
    ! A short flight back to its own flank, the other one out of reach, is seen from that.
    chart = instant%chart
    if (chart == instant%touching) then
      call expand_start(self%scene(view(self, chart)), curve)
      wall = [0.0_wp, -self%of%width - self%g_low]
      if (chart == coast_flank) wall = [self%of%width + self%g_low, 0.0_wp]
      call bounce(curve, wall, chart, stop, found, at)
      if (found) return
    end if
    chart = drive_flank
    call self%scene(on_moving)%flank%motion(instant%t, instant%piece, g, slope)
    c = 0
    c(0:1) = instant%y(1:2)
    c(2) = 0.5_wp*self%scene(on_moving)%force
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
    call curve_of_arc(self, from_drive, drive_flank, from_drive%piece, curve)
    call flight_end(self%scene(on_moving), curve, [0.0_wp, least_width], &
        merge(drive_flank, no_flank, instant%touching == drive_flank), latest, at)
    if (at%flank /= no_flank .or. .not. found) return
    at%flank = coast_flank
    call self%scene(on_moving)%flank%motion(instant%t + at%s, instant%piece, g, slope)
    at%v = at%v + slope
  end subroutine flight_to_standing

  !> Position and velocity relative to the flank of an arc's chart.
  subroutine state_at(self, system, arc, s, frame, y)
    class(exact_flow_t), intent(in) :: self
    class(system_t), intent(in) :: system        !! what moves
    type(arc_t), intent(in) :: arc               !! an arc it moved along
    real(wp), intent(in) :: s                    !! time since it began
    type(frame_t), intent(inout) :: frame        !! without effect
    real(wp), intent(out) :: y(max_states)       !! position and velocity
    type(curve_t) :: curve
    call curve_of(self, arc, arc%begin%chart, curve)
    y = 0
    associate (scene => self%scene(view(self, arc%begin%chart)))
      call expand_fully(scene, curve)
      call curve_at(scene, curve, panel_in_contact(scene, curve, s), s, y(1), y(2))
    end associate
  end subroutine state_at

  !> Position and velocity seen from a flank.
  pure function state_from(self, instant, flank) result(y)
    class(exact_flow_t), intent(in) :: self
    type(instant_t), intent(in) :: instant       !! where the tooth is
    integer, intent(in) :: flank
    real(wp) :: y(2), g, slope, sign
    y = instant%y(1:2)
    if (instant%chart == flank) return
    sign = merge(1.0_wp, -1.0_wp, flank == coast_flank)
    y(1) = y(1) + sign*self%of%width
    if (.not. allocated(self%of%fixed)) return
    call self%scene(on_moving)%flank%motion(instant%t, instant%piece, g, slope)
    y = y + sign*[g, slope]
  end function state_from

  !> Report where an arc comes near a flank, or near release, and turns back.
  subroutine near_turns(self, system, arc, within, listener, work)
    class(exact_flow_t), intent(in) :: self
    class(system_t), intent(in) :: system         !! what moves
    type(arc_t), intent(in) :: arc                !! an arc it moved along
    real(wp), intent(in) :: within                !! what is near, rad
    class(listener_t), intent(inout) :: listener  !! who hears of it
    type(work_t), intent(inout) :: work           !! counts
    type(curve_t) :: curve
    type(instant_t) :: instant
    type(frame_t) :: frame
    real(wp) :: inward, from, s
    integer :: flank
    logical :: found
    do flank = drive_flank, self%of%n_flanks
      if (arc%begin%motion_state /= separation .and. arc%begin%motion_state /= flank) cycle
      work%graze_searches = work%graze_searches + 1
      inward = merge(1.0_wp, -1.0_wp, (arc%begin%motion_state == separation) .eqv. &
          flank == coast_flank)
      frame = arc%frame
      call curve_of(self, arc, flank, curve)
      associate (scene => self%scene(view(self, flank)))
        call expand_fully(scene, curve)
        from = 0
        do
          call next_near_turn(scene, curve, inward, within, from, arc%length, found, s)
          if (.not. found) exit
          call instant_on(self, system, arc, s, frame, instant)
          call listener%hear(flank, instant)
          from = s
        end do
      end associate
    end do
  end subroutine near_turns

  !> Largest distance from the drive flank, or depth in the coast flank.
  subroutine farthest(self, system, arc, flank, least, largest, work)
    class(exact_flow_t), intent(in) :: self
    class(system_t), intent(in) :: system        !! what moves
    type(arc_t), intent(in) :: arc               !! an arc it moved along
    integer, intent(in) :: flank
    real(wp), intent(in) :: least                !! value known already, rad
    real(wp), intent(out) :: largest             !! the larger of the two, rad
    type(work_t), intent(inout) :: work          !! counts
    type(curve_t) :: curve
    work%depth_searches = work%depth_searches + 1
    associate (scene => self%scene(view(self, flank)))
      if (arc%begin%motion_state == separation .and. allocated(scene%bend)) then
        largest = farthest_over_parabolas(scene, arc%begin%t, locate_piece(scene%flank, &
            arc%begin%t, arc%frame%piece), state_from(self, arc%begin, flank), -1.0_wp, &
            arc%length, least)
        return
      end if
      call curve_of(self, arc, flank, curve)
      call expand_over(scene, curve, arc%length)
      largest = farthest_of(scene, curve, -1.0_wp, arc%length, least)
    end associate
  end subroutine farthest

  !> When a tooth in rigid contact would be pulled.
  subroutine rigid_release(self, system, instant, stop, known, found, s)
    class(exact_flow_t), intent(in) :: self
    class(system_t), intent(in) :: system        !! what moves
    type(instant_t), intent(in) :: instant       !! where the tooth is
    real(wp), intent(in) :: stop                 !! latest end
    logical, intent(out) :: known                !! whether g is a series
    logical, intent(out) :: found                !! whether it is
    real(wp), intent(out) :: s                   !! when
    known = is_smooth(self%scene(on_moving)%flank)
    found = .false.
    s = stop
    if (known) call rigid_contact_end(self%scene(on_moving), self%push, instant%motion_state, &
        instant%t, stop, found, s)
  end subroutine rigid_release
end module lapwing_flow_exact_exact_flow
