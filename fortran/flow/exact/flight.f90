!> How a flight ends in closed form: at a flank, or at a given time. No crossing is missed.
!>
!> Most of what cannot happen is ruled out cheaply: a short bounce by its own series, a panel by
!> Bernstein coefficients computed beforehand. `lapwing_flow_exact_root_search` looks closely at the
!> rest.
module lapwing_flow_exact_flight
  use lapwing_kinds, only: wp
  use lapwing_codes, only: no_flank, drive_flank, coast_flank
  use lapwing_flow, only: start_order
  use lapwing_flow_exact_curve, only: scene_t, curve_t, expand_start, expand_fully, is_smooth
  use lapwing_flow_exact_motion, only: curve_at, flight_at_edge, fly_to_knot, flight_series, &
      flight_on_piece, range_of_flight
  use lapwing_flow_exact_interval_bounds, only: widest_level, block_at, last_in_block
  use lapwing_flow_exact_panels, only: closed_form_t, locate_panel, reach
  use lapwing_system_oscillation, only: n_taylor
  use lapwing_flow_exact_root_search, only: target_t, first_crossing, quick_return, only_zero
  use lapwing_polynomial_evaluation, only: max_degree, horner, horner_slope, bernstein_on, &
      least, largest
  use lapwing_polynomial_roots, only: first_descent, is_parabola, parabola_descent
  use lapwing_flank, only: locate_piece
  use lapwing_system_exclusion, only: no_sooner
  implicit none
  private
  public :: end_t, flight_end, bounce, least_width

  !> A direction in which nothing is met.
  real(wp), parameter :: least_width = -huge(1.0_wp)

  !> The end of an arc.
  type :: end_t
    integer :: flank = no_flank    !! flank met, or none: the arc may go on
    real(wp) :: s = 0              !! duration
    real(wp) :: x = 0, v = 0       !! position and velocity, of the same flank as the beginning's
  end type end_t

contains

  !> End of a flight between a wall above (the drive flank) and one below (the coast flank), both
  !> moving with the flank the flight is seen from.
  pure subroutine flight_end(scene, curve, wall, touching, stop, at)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(inout) :: curve      !! arc
    real(wp), intent(in) :: wall(2)            !! positions of the flanks; -huge: no coast flank
    integer, intent(in) :: touching            !! flank at zero distance, left at s = 0
    real(wp), intent(in) :: stop               !! latest end
    type(end_t), intent(out) :: at             !! the end
    logical :: found, smooth
    if (curve%near < 0) call expand_start(scene, curve)
    smooth = is_smooth(scene%flank)
    ! Over a parabola the return to the flank left is found by formula, however short it is.
    if (touching /= no_flank .and. (smooth .or. .not. is_parabola(curve%taylor(0:max_degree)))) then
      call bounce(curve, wall, touching, stop, found, at)
      if (found) return
    end if
    if (smooth) then
      call flight_over_series(scene, curve, wall, touching, stop, at)
    else
      call flight_over_table(scene, curve, wall, touching, stop, at)
    end if
  end subroutine flight_end

  !> A flight back to the flank it left, too short to be anything else.
  pure subroutine bounce(curve, wall, touching, stop, found, at)
    type(curve_t), intent(in) :: curve         !! arc, its series known
    real(wp), intent(in) :: wall(2)            !! positions of the flanks
    integer, intent(in) :: touching            !! flank left
    real(wp), intent(in) :: stop               !! latest end
    logical, intent(out) :: found              !! whether it is one
    type(end_t), intent(out) :: at             !! its end
    real(wp) :: speed, s, most, value, slope
    integer :: k, n
    found = .false.
    speed = merge(-curve%v, curve%v, touching == drive_flank)
    if (.not. speed > 0) return
    if (1.5_wp*speed > curve%near*abs(curve%taylor(2))) return
    most = min(curve%near, stop, (wall(1) - wall(2))/speed)
    n = curve%degree
    if (touching == drive_flank) then
      call quick_return(curve%taylor(2:n), speed, most, found, s)
    else
      call quick_return(-curve%taylor(2:n), speed, most, found, s)
    end if
    if (.not. found) return
    at%flank = touching
    at%s = s
    at%x = wall(touching)
    ! With x = v s + s**2 p(s) = 0, the velocity without v is s (p + s p').
    value = curve%taylor(n)
    slope = 0
    do k = n - 1, 2, -1
      slope = slope*s + value
      value = value*s + curve%taylor(k)
    end do
    at%v = s*(value + s*slope)
  end subroutine bounce

  !> A flight over table pieces: on each the motion is a polynomial.
  pure subroutine flight_over_table(scene, curve, wall, touching, stop, at)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve         !! arc, its series known
    real(wp), intent(in) :: wall(2)            !! positions of the flanks
    integer, intent(in) :: touching            !! flank at zero distance, left at s = 0
    real(wp), intent(in) :: stop               !! latest end
    type(end_t), intent(out) :: at             !! the end
    real(wp) :: c(0:max_degree), begin, to, s, x, v
    integer :: piece, next, left
    c = curve%taylor(0:max_degree)
    piece = curve%piece
    begin = 0
    left = touching
    do
      to = min(scene%flank%knot(piece + 1) - curve%t, stop)
      call first_wall(c, to - begin, wall, left, at%flank, s)
      at%s = begin + s
      at%x = horner(c, s)
      at%v = horner_slope(c, s)
      if (at%flank /= no_flank .or. to >= stop .or. piece == scene%flank%n) exit
      left = no_flank
      begin = to
      piece = piece + 1
      next = piece
      if (scene%blocks%pieces%levels > 0) call pass_blocks(scene, curve, wall, stop, next)
      x = at%x
      ! Off kinks the jump is rounding, but left out it would add up to a mean force.
      v = at%v - scene%flank%slope_jump(piece)
      if (next > piece) then
        piece = next
        begin = scene%flank%knot(piece) - curve%t
        call fly_to_knot(scene, curve, piece, x, v)
      end if
      c = flight_on_piece(scene, piece, x, v)
    end do
    if (at%flank == no_flank) at%s = stop
  end subroutine flight_over_table

  !> From a piece that begins a block past all blocks on which neither flank can be met.
  pure subroutine pass_blocks(scene, curve, wall, stop, piece)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve         !! arc
    real(wp), intent(in) :: wall(2)            !! positions of the flanks
    real(wp), intent(in) :: stop               !! latest end
    integer, intent(inout) :: piece            !! piece, then the one to be looked at next
    real(wp) :: finish
    integer :: level, after
    associate (row => scene%blocks%pieces)
      do
        do level = widest_level(row, piece), 1, -1
          after = last_in_block(row, level, piece) + 1
          finish = min(scene%flank%knot(after) - curve%t, stop)
          if (is_between(block_at(row, level, piece))) exit
        end do
        if (level == 0) return
        if (finish >= stop) then
          ! The piece with the stop in it, or at its end, is looked at like any other.
          after = locate_piece(scene%flank, curve%t + stop, after - 1)
          if (scene%flank%knot(after) - curve%t >= stop) after = after - 1
          piece = max(piece, after)
          return
        end if
        piece = after
      end do
    end associate
  contains
    !> Whether the tooth stays between the flanks, over a block up to `finish`.
    pure logical function is_between(block)
      integer, intent(in) :: block
      real(wp) :: low, high
      call range_of_flight(scene, curve, scene%flank%knot(piece) - curve%t, finish, low, high)
      is_between = high < scene%blocks%g_low(block) + wall(1) &
          .and. low > scene%blocks%g_high(block) + wall(2)
    end function is_between
  end subroutine pass_blocks

  !> First wall that a polynomial meets: a parabola by formula, any other by isolating its roots.
  pure subroutine first_wall(c, length, wall, left, flank, s)
    real(wp), intent(in) :: c(0:max_degree)    !! position
    real(wp), intent(in) :: length             !! interval
    real(wp), intent(in) :: wall(2)            !! positions of the walls
    integer, intent(in) :: left                !! wall left at zero, or none
    integer, intent(out) :: flank              !! wall met, or none
    real(wp), intent(out) :: s                 !! when, or `length`
    real(wp) :: b(0:max_degree), f(0:max_degree), at
    integer :: k
    logical :: bends_once, found
    bends_once = is_parabola(c)
    if (.not. bends_once) b = bernstein_on(c, length)
    flank = no_flank
    s = length
    do k = drive_flank, coast_flank
      if (k /= left .and. .not. bends_once) then
        if (k == drive_flank) then
          if (largest(b) < wall(k)) cycle
        else if (least(b) > wall(k)) then
          cycle
        end if
      end if
      f = c
      f(0) = merge(0.0_wp, c(0) - wall(k), k == left)
      if (k == drive_flank) f = -f
      if (bends_once) then
        call parabola_descent(f(0:2), s, k == left, found, at)
      else
        call first_descent(f, s, k == left, found, at)
      end if
      if (.not. found) cycle
      flank = k
      s = at
    end do
  end subroutine first_wall

  !> A flight over a harmonic flank: panels, the first one from the arc's beginning.
  pure subroutine flight_over_series(scene, curve, wall, touching, stop, at)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(inout) :: curve      !! arc, its series known
    real(wp), intent(in) :: wall(2)            !! positions of the flanks
    integer, intent(in) :: touching            !! flank at zero distance, left at s = 0
    real(wp), intent(in) :: stop               !! latest end
    type(end_t), intent(out) :: at             !! the end
    real(wp) :: from, to, theta, rate, next, b(0:max_degree), sag, state(2)
    integer :: panel
    logical :: out(2), may_skip
    associate (form => scene%form)
      panel = locate_panel(form, curve%t)
      may_skip = scene%force > 0
      from = 0
      theta = curve%x + curve%flank(1)
      rate = curve%v + curve%flank(2)
      do
        to = min(form%edge(panel + 1) - curve%t, stop)
        next = (curve%x + curve%flank(1)) + (rate + 0.5_wp*scene%force*to)*to
        associate (here => form%panel(panel))
          if (from > 0) then
            ! A parabola is this far below its chord, at most.
            sag = 0.5_wp*scene%force*here%half**2
            out = [max(theta, next) - min(sag, 0.0_wp) < here%g_low + wall(1), &
                min(theta, next) - max(sag, 0.0_wp) > here%g_high + wall(2)]
            if (.not. all(out)) then
              b = parabola(theta, rate + scene%force*from, scene%force, 2*here%half) &
                  - here%g_bernstein
              out = [largest(b) + here%g_rest < wall(1), least(b) - here%g_rest > wall(2)]
              if (out(1) .neqv. out(2)) then
                call cross_only(scene, curve, panel, wall, merge(coast_flank, drive_flank, &
                    out(1)), b, to, out, at)
              end if
            end if
          else
            out = ruled_out(curve, wall, touching, to, form%g_bound)
          end if
        end associate
        if (.not. all(out)) call search_panel(scene, curve, panel, wall, &
            merge(no_flank, touching, from > 0), from, to, out, at)
        if (at%flank /= no_flank) return
        if (to >= stop .or. panel == form%n) exit
        theta = next
        from = to
        panel = panel + 1
        if (may_skip) then
          call skip_ahead(form, curve%t, scene%force, rate, wall, stop, panel, from, theta)
          may_skip = theta >= form%g_low + wall(1)
        end if
      end do
      at%s = stop
      if (stop > curve%near .and. curve%t + stop >= form%edge(panel + 1)) then
        state = flight_at_edge(scene, curve, panel + 1, stop)
        at%x = state(1)
        at%v = state(2)
      else
        call curve_at(scene, curve, panel, stop, at%x, at%v)
      end if
    end associate
  end subroutine flight_over_series

  !> Move on, where that is possible, to the panel in which a flight can first meet the drive flank
  !> again: a parabola that opens upwards lies below its chord.
  pure subroutine skip_ahead(form, t, force, rate, wall, stop, panel, from, theta)
    type(closed_form_t), intent(in) :: form    !! scene
    real(wp), intent(in) :: t                  !! cycle time of the flight's beginning
    real(wp), intent(in) :: force              !! F, positive
    real(wp), intent(in) :: rate               !! theta' there
    real(wp), intent(in) :: wall(2)            !! positions of the flanks
    real(wp), intent(in) :: stop               !! latest end
    integer, intent(inout) :: panel
    real(wp), intent(inout) :: from            !! its beginning, after that
    real(wp), intent(inout) :: theta           !! position then
    real(wp) :: here, room, later, there, height
    integer :: k
    here = rate + force*from
    room = (form%g_low + wall(1)) - theta
    if (.not. room > 0) return
    if (theta - 0.5_wp*min(here, 0.0_wp)**2/force <= form%g_high + wall(2)) return
    later = no_sooner(room, here, force)
    k = locate_panel(form, t + min(from + later, stop))
    if (k <= panel) return
    there = form%edge(k) - t
    height = theta + (here + 0.5_wp*force*(there - from))*(there - from)
    ! The height at the edge decides, not the rounded root.
    if (height >= form%g_low + wall(1) .or. there >= stop) return
    panel = k
    from = there
    theta = height
  end subroutine skip_ahead

  !> The one crossing of a wall within a panel, where it is plain that there is just one.
  pure subroutine cross_only(scene, curve, panel, wall, flank, b, to, out, at)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve         !! arc
    integer, intent(in) :: panel
    real(wp), intent(in) :: wall(2)            !! positions of the flanks
    integer, intent(in) :: flank               !! the one that is met
    real(wp), intent(in) :: b(0:max_degree)    !! Bernstein coefficients of x
    real(wp), intent(in) :: to                 !! time up to which it counts
    logical, intent(inout) :: out(2)           !! flanks that need not be looked at any more
    type(end_t), intent(inout) :: at           !! the end, if it is found
    real(wp) :: c(0:n_taylor), s, sign, v
    logical :: settled
    sign = merge(-1.0_wp, 1.0_wp, flank == drive_flank)
    call flight_series(scene, curve, panel, sign, wall(flank), c)
    associate (here => scene%form%panel(panel))
      call only_zero(c, here%half, sign*(b - wall(flank)), here%g_rest, settled, s, v)
      s = (here%middle - curve%t) + s
    end associate
    ! Near its beginning the arc's own series keeps more digits.
    if (.not. settled .or. s <= reach(start_order)/scene%form%fastest) return
    out(flank) = .true.
    if (s <= to) at = end_t(flank, s, wall(flank), sign*v)
  end subroutine cross_only

  !> Bernstein coefficients of degree five of a parabola on [0, width].
  pure function parabola(x, v, a, width) result(b)
    real(wp), intent(in) :: x, v, a           !! position, velocity, acceleration
    real(wp), intent(in) :: width             !! interval
    real(wp) :: b(0:max_degree)
    integer :: j
    real(wp), parameter :: linear(0:max_degree) = [(0.2_wp*j, j = 0, max_degree)]
    real(wp), parameter :: square(0:max_degree) = [(0.05_wp*j*(j - 1), j = 0, max_degree)]
    b = x + (v*width)*linear + (0.5_wp*a*width**2)*square
  end function parabola

  !> Which walls the first part of a flight cannot meet, by its series about the beginning.
  pure function ruled_out(curve, wall, touching, to, bound) result(out)
    type(curve_t), intent(in) :: curve         !! arc
    real(wp), intent(in) :: wall(2)            !! positions of the flanks
    integer, intent(in) :: touching            !! flank left at s = 0
    real(wp), intent(in) :: to                 !! end of the part
    real(wp), intent(in) :: bound              !! of what the series leaves out
    logical :: out(2)
    real(wp) :: b(0:max_degree), c(0:max_degree), rest
    c = curve%taylor(0:max_degree)
    rest = bound*to**(max_degree + 1)
    if (touching == no_flank) then
      b = bernstein_on(c, to)
      out = [largest(b) + rest < wall(1), least(b) - rest > wall(2)]
    else
      ! It leaves a wall: without its zero there the distance must stay positive.
      c = [c(1:max_degree), 0.0_wp]
      if (touching == drive_flank) c = -c
      b = to*bernstein_on(c, to)
      out(touching) = least(b) > rest
      out(3 - touching) = largest(b) + rest < wall(1) - wall(2)
    end if
  end function ruled_out

  !> First crossing, within a panel, of those walls that are not ruled out.
  pure subroutine search_panel(scene, curve, panel, wall, touching, from, to, out, at)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(inout) :: curve      !! arc
    integer, intent(in) :: panel
    real(wp), intent(in) :: wall(2)            !! positions of the flanks
    integer, intent(in) :: touching            !! flank left at s = 0
    real(wp), intent(in) :: from, to           !! where to look
    logical, intent(in) :: out(2)              !! flanks that cannot be met
    type(end_t), intent(inout) :: at           !! the end, if there is one
    real(wp) :: latest, s, x, v
    integer :: flank
    logical :: found
    call expand_fully(scene, curve)
    latest = to
    do flank = drive_flank, coast_flank
      if (out(flank)) cycle
      call first_crossing(scene, curve, panel, from > 0, target_t(sign=merge(-1.0_wp, 1.0_wp, &
          flank == drive_flank), wall=wall(flank), touching=flank == touching), &
          from, latest, found, s, x, v)
      if (.not. found) cycle
      at = end_t(flank, s, x, v)
      latest = s
    end do
  end subroutine search_panel
end module lapwing_flow_exact_flight
