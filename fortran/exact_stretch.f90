!> How a smooth stretch ends: at a flank, or at a given time. In closed form, no crossing missed.
!>
!> Most of what cannot happen is ruled out cheaply: a short bounce by its own series, a panel by
!> Bernstein coefficients computed beforehand, all that is left of a contact by the size of the
!> free oscillation in it. `lapwing_first_meeting` looks closely at what remains.
module lapwing_exact_stretch
  use lapwing_kinds, only: wp
  use lapwing_codes, only: no_flank, drive_flank, coast_flank
  use lapwing_closed_form, only: locate_panel, reach
  use lapwing_damped, only: free_motion
  use lapwing_first_meeting, only: target_t, first_meeting, quick_return
  use lapwing_polynomial, only: max_degree, horner, horner_slope, bernstein, bernstein_on, &
      first_descent
  use lapwing_smooth_curve, only: scene_t, curve_t, launch, expand_launch, curve_at, &
      free_state, fly_from
  implicit none
  private
  public :: end_t, flight_end, contact_end, bounce, least_width

  !> A direction in which nothing is met.
  real(wp), parameter :: least_width = -huge(1.0_wp)

  !> The end of a stretch.
  type :: end_t
    integer :: flank = no_flank    !! flank met, or none: the stretch lasts until its stop
    real(wp) :: s = 0              !! duration
    real(wp) :: x = 0, v = 0       !! position and velocity, of the same flank as the beginning's
  end type end_t

contains

  !> End of a flight between a wall above (the drive flank) and one below (the coast flank), both
  !> moving with the flank the flight is told from.
  pure subroutine flight_end(scene, curve, wall, touching, stop, at)
    type(scene_t), intent(in) :: scene         !! scene
    type(curve_t), intent(inout) :: curve      !! stretch
    real(wp), intent(in) :: wall(2)            !! positions of the flanks; -huge: no coast flank
    integer, intent(in) :: touching            !! flank at zero distance, left at s = 0
    real(wp), intent(in) :: stop               !! latest end
    type(end_t), intent(out) :: at             !! the end
    logical :: found
    if (curve%near < 0) call expand_launch(scene, curve)
    if (touching /= no_flank) then
      call bounce(curve, wall, touching, stop, found, at)
      if (found) return
    end if
    if (scene%form%harmonic .and. curve%moving) then
      call flight_over_series(scene, curve, wall, touching, stop, at)
    else
      call flight_over_table(scene, curve, wall, touching, stop, at)
    end if
  end subroutine flight_end

  !> A flight back to the flank it left, too short to be anything else.
  pure subroutine bounce(curve, wall, touching, stop, found, at)
    type(curve_t), intent(in) :: curve         !! stretch, its series known
    real(wp), intent(in) :: wall(2)            !! positions of the flanks
    integer, intent(in) :: touching            !! flank left
    real(wp), intent(in) :: stop               !! latest end
    logical, intent(out) :: found              !! whether it is one
    type(end_t), intent(out) :: at             !! its end
    real(wp) :: speed, s, most
    integer :: k, n
    found = .false.
    speed = merge(-curve%v, curve%v, touching == drive_flank)
    if (.not. speed > 0) return
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
    ! The velocity without the speed at the beginning, which the return has used up.
    at%v = (n - 1)*curve%taylor(n)
    do k = n - 1, 2, -1
      at%v = at%v*s + (k - 1)*curve%taylor(k)
    end do
    at%v = at%v*s
  end subroutine bounce

  !> A flight over table pieces: on each the motion is a polynomial.
  pure subroutine flight_over_table(scene, curve, wall, touching, stop, at)
    type(scene_t), intent(in) :: scene         !! scene
    type(curve_t), intent(in) :: curve         !! stretch, its series known
    real(wp), intent(in) :: wall(2)            !! positions of the flanks
    integer, intent(in) :: touching            !! flank at zero distance, left at s = 0
    real(wp), intent(in) :: stop               !! latest end
    type(end_t), intent(out) :: at             !! the end
    real(wp) :: c(0:max_degree), begin, to, s
    integer :: piece, left
    c = curve%taylor(0:max_degree)
    piece = curve%piece
    begin = 0
    left = touching
    do
      to = stop
      if (curve%moving) to = min(scene%table%knot(piece + 1) - curve%t, stop)
      call meet_walls(c, to - begin, wall, left, at%flank, s)
      at%s = begin + s
      at%x = horner(c, s)
      at%v = horner_slope(c, s)
      if (at%flank /= no_flank .or. to >= stop) exit
      left = no_flank
      begin = to
      piece = piece + 1
      c = -scene%table%coefficient(:, piece)
      c(0) = at%x
      ! Off kinks the jump is rounding, but left out it would add up to a mean force.
      c(1) = at%v - scene%table%slope_jump(piece)
      c(2) = c(2) + 0.5_wp*scene%force
    end do
    if (at%flank == no_flank) at%s = stop
  end subroutine flight_over_table

  !> First wall that a polynomial meets.
  pure subroutine meet_walls(c, length, wall, left, flank, s)
    real(wp), intent(in) :: c(0:max_degree)    !! position
    real(wp), intent(in) :: length             !! interval
    real(wp), intent(in) :: wall(2)            !! positions of the walls
    integer, intent(in) :: left                !! wall left at zero, or none
    integer, intent(out) :: flank              !! wall met, or none
    real(wp), intent(out) :: s                 !! when, or `length`
    real(wp) :: b(0:max_degree), f(0:max_degree), power, at
    integer :: k
    logical :: found
    power = 1
    do k = 0, max_degree
      b(k) = c(k)*power
      power = power*length
    end do
    b = bernstein(b)
    flank = no_flank
    s = length
    do k = drive_flank, coast_flank
      if (k /= left) then
        if (k == drive_flank) then
          if (maxval(b) < wall(k)) cycle
        else if (minval(b) > wall(k)) then
          cycle
        end if
      end if
      f = c
      f(0) = merge(0.0_wp, c(0) - wall(k), k == left)
      if (k == drive_flank) f = -f
      call first_descent(f, s, k == left, found, at)
      if (.not. found) cycle
      flank = k
      s = at
    end do
  end subroutine meet_walls

  !> A flight over a harmonic flank: panels, the first one from the launch.
  pure subroutine flight_over_series(scene, curve, wall, touching, stop, at)
    type(scene_t), intent(in) :: scene         !! scene
    type(curve_t), intent(in) :: curve         !! stretch, its series known
    real(wp), intent(in) :: wall(2)            !! positions of the flanks
    integer, intent(in) :: touching            !! flank at zero distance, left at s = 0
    real(wp), intent(in) :: stop               !! latest end
    type(end_t), intent(out) :: at             !! the end
    real(wp) :: from, to, theta, rate, b(0:max_degree), width, next_theta, lowest
    integer :: panel
    associate (form => scene%form)
      panel = locate_panel(form, curve%t)
      from = 0
      theta = curve%x + curve%flank(1)
      rate = curve%v + curve%flank(2)
      lowest = least_theta(theta, rate, scene%force)
      do
        to = min(form%edge(panel + 1) - curve%t, stop)
        next_theta = (curve%x + curve%flank(1)) + (rate + 0.5_wp*scene%force*to)*to
        if (from > 0 .and. scene%force > 0 .and. lowest > form%g_high + wall(2) &
            .and. max(theta, next_theta) < form%g_low + wall(1)) then
          ! A parabola that opens upwards lies below its chord, and this one above all coast flanks.
          continue
        else if (from > 0) then
          width = form%edge(panel + 1) - form%edge(panel)
          b = parabola(theta, rate + scene%force*from, scene%force, width) &
              - form%g_bernstein(:, panel)
          call look_closely(scene, curve, panel, wall, no_flank, from, to, &
              [maxval(b) + form%g_rest(panel) < wall(1), &
              minval(b) - form%g_rest(panel) > wall(2)], at)
        else
          call look_closely(scene, curve, panel, wall, touching, from, to, &
              ruled_out(curve, wall, touching, to, form%g_bound), at)
        end if
        if (at%flank /= no_flank) return
        if (to >= stop) exit
        theta = next_theta
        from = to
        panel = panel + 1
      end do
      at%s = stop
      if (stop > curve%near .and. curve%t + stop >= form%edge(panel + 1)) then
        call fly_from(scene, curve, stop, form%g_taylor(0, panel + 1), &
            form%g_taylor(1, panel + 1), at%x, at%v)
      else
        call curve_at(scene, curve, panel, stop, at%x, at%v)
      end if
    end associate
  end subroutine flight_over_series

  !> Least value of theta + rate*s + force*s**2/2 over s >= 0, or less.
  pure real(wp) function least_theta(theta, rate, force)
    real(wp), intent(in) :: theta, rate, force   !! position, velocity, acceleration
    least_theta = theta
    if (rate >= 0) return
    least_theta = least_width
    if (force > 0) least_theta = theta - 0.5_wp*rate**2/force
  end function least_theta

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

  !> Which walls the first part of a flight cannot meet, by its series about the launch.
  pure function ruled_out(curve, wall, touching, to, bound) result(out)
    type(curve_t), intent(in) :: curve         !! stretch
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
      out = [maxval(b) + rest < wall(1), minval(b) - rest > wall(2)]
    else
      ! It leaves a wall: without its zero there the distance must stay positive.
      c = [c(1:max_degree), 0.0_wp]
      if (touching == drive_flank) c = -c
      b = to*bernstein_on(c, to)
      out(touching) = minval(b) > rest
      out(3 - touching) = maxval(b) + rest < wall(1) - wall(2)
    end if
  end function ruled_out

  !> First meeting, within a panel, with those walls that are not ruled out.
  pure subroutine look_closely(scene, curve, panel, wall, touching, from, to, out, at)
    type(scene_t), intent(in) :: scene         !! scene
    type(curve_t), intent(in) :: curve         !! stretch
    integer, intent(in) :: panel               !! panel
    real(wp), intent(in) :: wall(2)            !! positions of the flanks
    integer, intent(in) :: touching            !! flank left at s = 0
    real(wp), intent(in) :: from, to           !! where to look
    logical, intent(in) :: out(2)              !! flanks that cannot be met
    type(end_t), intent(inout) :: at           !! the end, if there is one
    real(wp) :: latest, s, x, v
    integer :: flank
    logical :: found
    latest = to
    at%flank = no_flank
    do flank = drive_flank, coast_flank
      if (out(flank)) cycle
      call first_meeting(scene, curve, panel, from > 0, target_t(sign=merge(-1.0_wp, 1.0_wp, &
          flank == drive_flank), wall=wall(flank), touching=flank == touching), &
          from, latest, found, s, x, v)
      if (.not. found) cycle
      at = end_t(flank, s, x, v)
      latest = s
    end do
  end subroutine look_closely

  !> End of a contact: release, or the stop.
  pure subroutine contact_end(scene, curve, flank, touching, stop, at)
    type(scene_t), intent(in) :: scene         !! scene
    type(curve_t), intent(inout) :: curve      !! stretch; told from a later knot where that is near
    integer, intent(in) :: flank               !! flank in contact
    logical, intent(in) :: touching            !! whether it begins at zero and goes in
    real(wp), intent(in) :: stop               !! latest end
    type(end_t), intent(out) :: at             !! the end
    type(target_t) :: goal
    integer :: panel
    logical :: found
    real(wp) :: s, elapsed, last
    goal%sign = merge(1.0_wp, -1.0_wp, flank == drive_flank)
    goal%touching = touching
    panel = 0
    elapsed = 0
    found = .false.
    if (.not. stays(scene, curve%moving, goal%sign, curve%free)) then
      call expand_launch(scene, curve)
      if (touching) call short_contact(curve, goal%sign, stop, found, s)
      if (found) then
        panel = locate_panel(scene%form, curve%t)
        call curve_at(scene, curve, panel, s, at%x, at%v)
      else
        call cross_near_knots(scene, goal, stop, curve, elapsed, found, s, at%x, at%v)
      end if
      if (.not. found) then
        last = stop
        if (elapsed > 0) last = at_edge(scene, curve%t, stop - elapsed)
        call release(scene, curve, goal, last, panel, found, s, at%x, at%v)
      end if
    end if
    if (found) then
      at%flank = flank
      at%s = elapsed + s
    else
      at%s = stop
      s = stop
      if (elapsed > 0) s = at_edge(scene, curve%t, stop - elapsed)
      if (panel == 0) panel = last_panel(scene, curve%t + s)
      call curve_at(scene, curve, panel, s, at%x, at%v)
    end if
  end subroutine contact_end

  !> A time that is a panel's edge but for rounding, put onto it.
  pure real(wp) function at_edge(scene, t, s) result(time)
    type(scene_t), intent(in) :: scene         !! scene
    real(wp), intent(in) :: t                  !! time in the cycle
    real(wp), intent(in) :: s                  !! time after it
    integer :: panel
    real(wp) :: edge
    panel = last_panel(scene, t + s)
    edge = scene%form%edge(panel + 1)
    time = s
    if (abs((t + s) - edge) <= 2*spacing(scene%form%period)) time = edge - t
  end function at_edge

  !> A contact that begins just before a knot of a table goes on from there with a series of its
  !> own, so that it keeps its relative precision while it is small.
  pure subroutine cross_near_knots(scene, goal, stop, curve, elapsed, found, s, x, v)
    type(scene_t), intent(in) :: scene         !! scene
    type(target_t), intent(inout) :: goal      !! release
    real(wp), intent(in) :: stop               !! latest end
    type(curve_t), intent(inout) :: curve      !! stretch, told from the last knot crossed
    real(wp), intent(out) :: elapsed           !! time until that
    logical, intent(out) :: found              !! whether the release comes before it
    real(wp), intent(out) :: s                 !! when, after `elapsed`
    real(wp), intent(out) :: x, v              !! position and velocity then
    real(wp) :: knot
    integer :: piece
    elapsed = 0
    found = .false.
    s = 0
    x = 0
    v = 0
    if (scene%form%harmonic .or. .not. curve%moving) return
    do
      piece = curve%piece + 1
      knot = scene%table%knot(piece) - curve%t
      if (elapsed + knot >= reach/scene%form%fastest .or. knot >= stop - elapsed) return
      call first_meeting(scene, curve, locate_panel(scene%form, curve%t), .false., goal, 0.0_wp, &
          knot, found, s, x, v)
      if (found) return
      x = horner(curve%taylor, knot)
      v = horner_slope(curve%taylor, knot) - scene%table%slope_jump(piece)
      elapsed = elapsed + knot
      goal%touching = .false.
      call launch(scene, .true., .true., scene%table%knot(piece), piece, x, v, curve)
      call expand_launch(scene, curve)
    end do
  end subroutine cross_near_knots

  !> Panel that holds t, or ends there as far as time can tell.
  pure integer function last_panel(scene, t) result(panel)
    type(scene_t), intent(in) :: scene         !! scene
    real(wp), intent(in) :: t                  !! time in the cycle
    panel = locate_panel(scene%form, t)
    if (panel == 1) return
    if (t <= scene%form%edge(panel) + 2*spacing(scene%form%period)) panel = panel - 1
  end function last_panel

  !> Whether the free oscillation is too small to let the tooth off, now and for ever.
  pure logical function stays(scene, moving, sign, free)
    type(scene_t), intent(in) :: scene         !! scene
    logical, intent(in) :: moving              !! whether the flank moves with g
    real(wp), intent(in) :: sign               !! +1 at the drive flank, -1 at the coast flank
    real(wp), intent(in) :: free(2)            !! d and d'
    real(wp) :: margin
    margin = sign*scene%force
    if (moving) margin = margin + merge(scene%form%q_low, -scene%form%q_high, sign > 0)
    stays = margin > 0 .and. free(1)**2 + free(2)**2 < margin**2
  end function stays

  !> A contact too short for the spring to matter: the way in and out again.
  pure subroutine short_contact(curve, sign, stop, found, s)
    type(curve_t), intent(in) :: curve         !! stretch, its series known
    real(wp), intent(in) :: sign               !! +1 at the drive flank, -1 at the coast flank
    real(wp), intent(in) :: stop               !! latest end
    logical, intent(out) :: found              !! whether it is one
    real(wp), intent(out) :: s                 !! its end
    call quick_return(-sign*curve%taylor(2:), sign*curve%v, min(stop, curve%near), found, s)
  end subroutine short_contact

  !> Release of a contact, panel by panel.
  pure subroutine release(scene, curve, goal, stop, panel, found, s, x, v)
    type(scene_t), intent(in) :: scene         !! scene
    type(curve_t), intent(in) :: curve         !! stretch, its series known
    type(target_t), intent(in) :: goal         !! release
    real(wp), intent(in) :: stop               !! latest end
    integer, intent(out) :: panel              !! panel of the end
    logical, intent(out) :: found              !! whether there is one
    real(wp), intent(out) :: s                 !! when
    real(wp), intent(out) :: x, v              !! position and velocity then
    real(wp) :: from, to, d, e, state(2)
    type(target_t) :: here
    logical :: out
    associate (form => scene%form)
      here = goal
      panel = locate_panel(form, curve%t)
      from = 0
      do
        to = min(form%edge(panel + 1) - curve%t, stop)
        if (from > 0) then
          out = holds(scene, curve%moving, goal%sign, panel, state)
        else
          ! The panel's own bound holds before the launch too, where it may be no contact at all.
          call free_motion(form%damping, to, d, e)
          state = free_state(form, curve%free, d, e)
          out = .false.
        end if
        found = .false.
        if (.not. out) call first_meeting(scene, curve, panel, from > 0, here, &
            from, to, found, s, x, v)
        if (found .or. to >= stop) return
        if (from > 0) state = matmul(form%d_matrix(:, :, panel), state)
        if (stays(scene, curve%moving, goal%sign, state)) then
          panel = 0
          return
        end if
        here%touching = .false.
        from = to
        panel = panel + 1
      end do
    end associate
  end subroutine release

  !> Whether contact holds over a whole panel, from the free oscillation at its beginning.
  pure logical function holds(scene, moving, sign, panel, free)
    type(scene_t), intent(in) :: scene         !! scene
    logical, intent(in) :: moving              !! whether the flank moves with g
    real(wp), intent(in) :: sign               !! +1 at the drive flank, -1 at the coast flank
    integer, intent(in) :: panel               !! panel
    real(wp), intent(in) :: free(2)            !! d and d'
    real(wp) :: b(0:max_degree), rest
    associate (form => scene%form)
      b = scene%force + form%d_bernstein(:, 1, panel)*free(1) &
          + form%d_bernstein(:, 2, panel)*free(2)
      rest = form%d_rest(panel)*(abs(free(1)) + abs(free(2)))
      if (moving) then
        b = b + form%q_bernstein(:, panel)
        rest = rest + form%q_rest(panel)
      end if
      if (sign > 0) then
        holds = minval(b) > rest
      else
        holds = maxval(b) < -rest
      end if
    end associate
  end function holds
end module lapwing_exact_stretch
