!> How a contact ends in closed form: by release, or at a given time. No release is missed.
!>
!> All that is left of a contact is ruled out by the size of the free oscillation in it, a panel by
!> Bernstein coefficients computed beforehand; `lapwing_first_meeting` looks closely at the rest.
module lapwing_exact_contact
  use lapwing_kinds, only: wp
  use lapwing_codes, only: drive_flank
  use lapwing_closed_form, only: locate_panel, reach
  use lapwing_damped, only: free_motion
  use lapwing_exact_flight, only: end_t
  use lapwing_first_meeting, only: target_t, first_meeting, quick_return
  use lapwing_polynomial, only: max_degree, horner, horner_slope
  use lapwing_smooth_curve, only: scene_t, curve_t, launch, expand_launch, curve_at, free_state
  implicit none
  private
  public :: contact_end

contains

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
    last = stop
    found = .false.
    if (.not. stays(scene, curve%moving, goal%sign, curve%free)) then
      call expand_launch(scene, curve)
      if (touching) call short_contact(curve, goal%sign, stop, found, s)
      if (found) then
        panel = locate_panel(scene%form, curve%t)
        call curve_at(scene, curve, panel, s, at%x, at%v)
      else
        call cross_near_knots(scene, goal, stop, curve, elapsed, last, found, s, at%x, at%v)
      end if
      if (.not. found) then
        call release(scene, curve, goal, last, panel, found, s, at%x, at%v)
      end if
    end if
    if (found) then
      at%flank = flank
      at%s = elapsed + s
    else
      at%s = stop
      if (panel == 0) panel = last_panel(scene, curve%t + last)
      call curve_at(scene, curve, panel, last, at%x, at%v)
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
  pure subroutine cross_near_knots(scene, goal, stop, curve, elapsed, last, found, s, x, v)
    type(scene_t), intent(in) :: scene         !! scene
    type(target_t), intent(inout) :: goal      !! release
    real(wp), intent(in) :: stop               !! latest end
    type(curve_t), intent(inout) :: curve      !! stretch, told from the last knot crossed
    real(wp), intent(out) :: elapsed           !! time until that
    real(wp), intent(out) :: last              !! latest end after it
    logical, intent(out) :: found              !! whether the release comes before it
    real(wp), intent(out) :: s                 !! when, after `elapsed`
    real(wp), intent(out) :: x, v              !! position and velocity then
    real(wp) :: knot
    integer :: piece
    elapsed = 0
    last = stop
    found = .false.
    s = 0
    x = 0
    v = 0
    if (scene%form%harmonic .or. .not. curve%moving) return
    do
      piece = curve%piece + 1
      knot = scene%table%knot(piece) - curve%t
      if (elapsed + knot >= reach/scene%form%fastest .or. knot >= last) return
      if (piece > scene%table%n) return
      call first_meeting(scene, curve, locate_panel(scene%form, curve%t), .false., goal, 0.0_wp, &
          knot, found, s, x, v)
      if (found) return
      x = horner(curve%taylor, knot)
      v = horner_slope(curve%taylor, knot) - scene%table%slope_jump(piece)
      elapsed = elapsed + knot
      goal%touching = .false.
      call launch(scene, .true., .true., scene%table%knot(piece), piece, x, v, curve)
      call expand_launch(scene, curve)
      last = at_edge(scene, curve%t, stop - elapsed)
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
        if (found .or. to >= stop .or. panel == form%n) return
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
end module lapwing_exact_contact
