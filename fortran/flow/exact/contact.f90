!> How a contact ends in closed form: by release, or at a given time. No release is missed.
!>
!> All that is left of a contact is ruled out by the size of the free oscillation in it, a panel by
!> Bernstein coefficients computed beforehand; `lapwing_flow_exact_root_search` looks closely at the
!> rest.
module lapwing_flow_exact_contact
  use lapwing_kinds, only: wp
  use lapwing_codes, only: no_flank, drive_flank, coast_flank
  use lapwing_flow, only: start_order
  use lapwing_flow_exact_curve, only: scene_t, curve_t, begin_curve, expand_start, expand_fully, &
      is_smooth
  use lapwing_system_oscillation, only: free_motion, free_state, n_taylor
  use lapwing_flow_exact_flight, only: end_t, flight_end
  use lapwing_flow_exact_root_search, only: target_t, first_crossing, quick_return, only_zero
  use lapwing_flow_exact_motion, only: curve_at, rest_after, free_in_middle, contact_series
  use lapwing_flow_exact_interval_bounds, only: widest_level, block_at, last_in_block
  use lapwing_flow_exact_panels, only: locate_panel, free_size, reach
  use lapwing_polynomial_evaluation, only: max_degree, horner, horner_slope, bernstein_on, least
  use lapwing_flow_exact_slow_contact, only: slow_crossing
  implicit none
  private
  public :: contact_end, rigid_contact_end

  !> Panels over which a free oscillation is carried from one middle to the next. Each adds a
  !> rounding or two of its size: four are a quarter of the 16 EPS that the state at a release may
  !> be off. From there on it is computed from the arc's beginning, for one exponential and one pair
  !> of sines. With 2 and 8 random scenes have the same events.
  integer, parameter :: well_rounded = 4
  !> Times that a contact is begun anew where knots are very many. One that lasts no longer keeps
  !> all its digits; one that ends after a longer time s keeps them but for some 4 EPS/s. So many of
  !> a million even pieces are 1e-4 of a period.
  integer, parameter :: most_begun = 128
  !> Rounding of a free oscillation that is carried over blocks of all levels and their members, a
  !> few hundred steps, over its size: far from above.
  real(wp), parameter :: carried_rounding = 1.0e-12_wp

contains

  !> End of a contact: release, or the stop; in a graded scene it may end before, of nothing.
  pure subroutine contact_end(scene, curve, flank, touching, stop, at)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(inout) :: curve      !! arc; begun anew at a knot that is near
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
    if (scene%form%graded) then
      call graded_contact_end(scene, curve, goal, flank, stop, at)
      return
    end if
    if (.not. stays(scene, goal%sign, curve%free)) then
      if (touching) then
        call expand_start(scene, curve)
        call short_contact(curve, goal%sign, stop, found, s)
      end if
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

  !> When a tooth in rigid contact would be pulled: F - g'' of a series falls to zero. It is the
  !> flight of a body without force over the flank -g'', seen from there.
  pure subroutine rigid_contact_end(scene, push, flank, t, stop, found, s)
    type(scene_t), intent(in) :: scene
    type(scene_t), intent(in) :: push          !! the flank -g''
    integer, intent(in) :: flank               !! flank in contact
    real(wp), intent(in) :: t                  !! cycle time of its beginning
    real(wp), intent(in) :: stop               !! latest end
    logical, intent(out) :: found              !! whether it would
    real(wp), intent(out) :: s                 !! when
    type(curve_t) :: curve
    type(end_t) :: at
    real(wp) :: g(0:max_degree), x, v
    integer :: touching
    call scene%flank%taylor(1, t, g)
    x = scene%force - 2*g(2)
    v = -6*g(3)
    touching = no_flank
    call begin_curve(push, .false., t, 1, x, v, curve)
    if (flank == drive_flank) then
      if (x <= 0) touching = coast_flank
      call flight_end(push, curve, [huge(x), 0.0_wp], touching, stop, at)
    else
      if (x >= 0) touching = drive_flank
      call flight_end(push, curve, [0.0_wp, -huge(x)], touching, stop, at)
    end if
    found = at%flank /= no_flank
    s = at%s
  end subroutine rigid_contact_end

  !> The same in a graded scene. A table's contact stops at the next knot, and no bound of q holds
  !> for longer.
  pure subroutine graded_contact_end(scene, curve, goal, flank, stop, at)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(inout) :: curve      !! arc
    type(target_t), intent(in) :: goal         !! release
    integer, intent(in) :: flank               !! flank in contact
    real(wp), intent(in) :: stop               !! latest end
    type(end_t), intent(out) :: at             !! the end
    integer :: panel
    logical :: found, surely
    surely = .false.
    if (is_smooth(scene%flank)) surely = stays(scene, goal%sign, curve%free)
    panel = last_panel(scene, curve%t + stop)
    at%s = stop
    if (.not. surely) then
      call expand_fully(scene, curve)
      found = .false.
      if (goal%touching) call short_contact(curve, goal%sign, stop, found, at%s)
      panel = locate_panel(scene%form, curve%t)
      if (.not. found) call slow_crossing(scene, curve, goal, 0.0_wp, stop, panel, found, at%s)
      if (found) at%flank = flank
    end if
    call curve_at(scene, curve, panel, at%s, at%x, at%v)
  end subroutine graded_contact_end

  !> A time that is a panel's edge but for rounding, put onto it.
  pure real(wp) function at_edge(scene, t, s) result(time)
    type(scene_t), intent(in) :: scene
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
    type(scene_t), intent(in) :: scene
    type(target_t), intent(inout) :: goal      !! release
    real(wp), intent(in) :: stop               !! latest end
    type(curve_t), intent(inout) :: curve      !! arc, begun anew at the last knot crossed
    real(wp), intent(out) :: elapsed           !! time until that
    real(wp), intent(out) :: last              !! latest end after it
    logical, intent(out) :: found              !! whether the release comes before it
    real(wp), intent(out) :: s                 !! when, after `elapsed`
    real(wp), intent(out) :: x, v              !! position and velocity then
    real(wp) :: knot
    integer :: piece, first
    elapsed = 0
    last = stop
    found = .false.
    s = 0
    x = 0
    v = 0
    if (scene%flank%n == 1) return
    first = curve%piece
    do
      piece = curve%piece + 1
      if (scene%blocks%pieces%levels > 1 .and. piece - first > most_begun) return
      knot = scene%flank%knot(piece) - curve%t
      if (elapsed + knot >= reach(start_order)/scene%form%fastest .or. knot >= last) return
      if (piece > scene%flank%n) return
      call expand_fully(scene, curve)
      call first_crossing(scene, curve, locate_panel(scene%form, curve%t), .false., goal, 0.0_wp, &
          knot, found, s, x, v)
      if (found) return
      x = horner(curve%taylor(:curve%degree), knot)
      v = horner_slope(curve%taylor(:curve%degree), knot) - scene%flank%slope_jump(piece)
      elapsed = elapsed + knot
      goal%touching = .false.
      call begin_curve(scene, .true., scene%flank%knot(piece), piece, x, v, curve)
      call expand_fully(scene, curve)
      last = at_edge(scene, curve%t, stop - elapsed)
    end do
  end subroutine cross_near_knots

  !> Panel that holds t, or ends there to the resolution of time.
  pure integer function last_panel(scene, t) result(panel)
    type(scene_t), intent(in) :: scene
    real(wp), intent(in) :: t                  !! time in the cycle
    panel = locate_panel(scene%form, t)
    if (panel == 1) return
    if (t <= scene%form%edge(panel) + 2*spacing(scene%form%period)) panel = panel - 1
  end function last_panel

  !> Whether the free oscillation is too small to let the tooth off, now and for ever.
  pure logical function stays(scene, sign, free)
    type(scene_t), intent(in) :: scene
    real(wp), intent(in) :: sign               !! +1 at the drive flank, -1 at the coast flank
    real(wp), intent(in) :: free(2)            !! d and d'
    real(wp) :: margin
    margin = sign*scene%force + merge(scene%form%q_low, -scene%form%q_high, sign > 0)
    stays = margin > 0 .and. free(1)**2 + free(2)**2 < margin**2
  end function stays

  !> A contact too short for the spring to matter: the way in and out again.
  pure subroutine short_contact(curve, sign, stop, found, s)
    type(curve_t), intent(in) :: curve         !! arc, its series known
    real(wp), intent(in) :: sign               !! +1 at the drive flank, -1 at the coast flank
    real(wp), intent(in) :: stop               !! latest end
    logical, intent(out) :: found              !! whether it is one
    real(wp), intent(out) :: s                 !! its end
    found = .false.
    s = 0
    if (1.5_wp*abs(curve%v) > curve%near*abs(curve%taylor(2))) return
    call quick_return(-sign*curve%taylor(2:curve%degree), sign*curve%v, &
        min(stop, curve%near), found, s)
  end subroutine short_contact

  !> Release of a contact, panel by panel.
  pure subroutine release(scene, curve, goal, stop, panel, found, s, x, v)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(inout) :: curve      !! arc
    type(target_t), intent(in) :: goal         !! release
    real(wp), intent(in) :: stop               !! latest end
    integer, intent(out) :: panel              !! panel of the end
    logical, intent(out) :: found              !! whether there is one
    real(wp), intent(out) :: s                 !! when
    real(wp), intent(out) :: x, v              !! position and velocity then
    real(wp) :: from, to, free(2), size_before, b(0:max_degree), rest
    integer :: first
    logical :: out, settled, touching
    associate (form => scene%form)
      panel = locate_panel(form, curve%t)
      first = panel
      free = free_in_middle(scene, curve, panel)
      touching = goal%touching
      from = 0
      found = .false.
      do
        to = min(form%edge(panel + 1) - curve%t, stop)
        call bound_contact(scene, goal%sign, panel, free, b, rest)
        ! A panel's bound holds before the arc begins, too, where it may be no contact at all.
        out = least(b) > rest
        if (touching) out = leaves(scene, curve, panel, goal%sign, to)
        if (.not. out) then
          settled = .false.
          if (from > 0 .or. curve%t == form%edge(panel)) call only_release(scene, curve, panel, &
              panel - first, goal%sign, free, b, rest, to, settled, found, s, x, v)
          if (.not. settled) then
            call expand_fully(scene, curve)
            call first_crossing(scene, curve, panel, from > 0, &
                target_t(goal%sign, goal%wall, touching), from, to, found, s, x, v)
          end if
        end if
        if (found .or. to >= stop .or. panel == form%n) return
        if (stays(scene, goal%sign, free)) then
          panel = 0
          return
        end if
        size_before = free_size(free)
        free = form%panel(panel)%d_matrix(:, 1)*free(1) + form%panel(panel)%d_matrix(:, 2)*free(2)
        touching = .false.
        panel = panel + 1
        if (scene%blocks%panels%levels > 0) then
          call pass_blocks(scene, goal%sign, size_before, panel, free)
          ! What is passed may hold the stop.
          if (form%edge(panel) - curve%t >= stop .or. panel > form%n) then
            panel = 0
            return
          end if
        end if
        from = form%edge(panel) - curve%t
      end do
    end associate
  end subroutine release

  !> From a panel that begins a block past all blocks over which the tooth cannot come off.
  pure subroutine pass_blocks(scene, sign, size_before, panel, free)
    type(scene_t), intent(in) :: scene
    real(wp), intent(in) :: sign               !! +1 at the drive flank, -1 at the coast flank
    real(wp), intent(in) :: size_before        !! size of the free oscillation, earlier
    integer, intent(inout) :: panel            !! panel, then the one to be looked at next, or n + 1
    real(wp), intent(inout) :: free(2)         !! d and d' in its middle
    integer :: level, last
    associate (row => scene%blocks%panels)
      do while (panel <= scene%form%n)
        do level = widest_level(row, panel), 1, -1
          last = last_in_block(row, level, panel)
          associate (block => scene%blocks%over(block_at(row, level, panel)))
            if (.not. holds(sign*scene%force + merge(block%q_low, -block%q_high, sign > 0))) cycle
            free = block%d_matrix(:, 1)*free(1) + block%d_matrix(:, 2)*free(2)
          end associate
          panel = last + 1
          exit
        end do
        if (level == 0) return
      end do
    end associate
  contains
    !> Whether what holds the tooth in a block, but for the free oscillation, is more than that. It
    !> never grows, and in a short block changes little: |d'| is not above its size either.
    pure logical function holds(margin)
      real(wp), intent(in) :: margin           !! F + q there, at least
      holds = size_before < margin
      if (holds .or. scene%blocks%panels%levels == 1) return
      holds = margin + sign*free(1) > size_before &
          *((scene%form%edge(last + 1) - scene%form%edge(panel)) + carried_rounding)
    end function holds
  end subroutine pass_blocks

  !> Bernstein coefficients of sign*x over a panel, and a bound of what they leave out.
  pure subroutine bound_contact(scene, sign, panel, free, b, rest)
    type(scene_t), intent(in) :: scene
    real(wp), intent(in) :: sign               !! +1 at the drive flank, -1 at the coast flank
    integer, intent(in) :: panel
    real(wp), intent(in) :: free(2)            !! d and d' in its middle
    real(wp), intent(out) :: b(0:max_degree)   !! coefficients
    real(wp), intent(out) :: rest              !! bound
    associate (here => scene%form%panel(panel))
      b = sign*(scene%force + here%d_bernstein(:, 1)*free(1) + here%d_bernstein(:, 2)*free(2) &
          + here%q_bernstein)
      rest = here%d_rest*(abs(free(1)) + abs(free(2))) + here%q_rest
    end associate
  end subroutine bound_contact

  !> Whether a contact that begins at zero lasts at least until `to`: its distance over the time
  !> stays positive.
  pure logical function leaves(scene, curve, panel, sign, to)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve         !! arc, its series known
    integer, intent(in) :: panel               !! panel that holds it until `to`
    real(wp), intent(in) :: sign               !! +1 at the drive flank, -1 at the coast flank
    real(wp), intent(in) :: to                 !! time since its beginning
    real(wp) :: c(0:max_degree)
    c = sign*[curve%taylor(1:max_degree), 0.0_wp]
    leaves = least(bernstein_on(c, to)) > rest_after(scene, curve, panel, 0.0_wp) &
        *to**max_degree
  end function leaves

  !> The one release within a panel, where it is plain that there is just one.
  pure subroutine only_release(scene, curve, panel, passed, sign, free, b, rest, to, settled, &
      found, s, x, v)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve         !! arc
    integer, intent(in) :: panel
    integer, intent(in) :: passed              !! panels since the arc began
    real(wp), intent(in) :: sign               !! +1 at the drive flank, -1 at the coast flank
    real(wp), intent(in) :: free(2)            !! d and d' in its middle
    real(wp), intent(in) :: b(0:max_degree)    !! Bernstein coefficients of sign*x
    real(wp), intent(in) :: rest               !! bound of what they leave out
    real(wp), intent(in) :: to                 !! time up to which it counts
    logical, intent(out) :: settled            !! whether it is plain
    logical, intent(out) :: found              !! whether it lies before `to`
    real(wp), intent(out) :: s                 !! when
    real(wp), intent(out) :: x, v              !! position and velocity then
    real(wp) :: c(0:n_taylor), d, e, middle, state(2)
    middle = scene%form%panel(panel)%middle - curve%t
    state = free
    if (passed > well_rounded) then
      call free_motion(scene%form%damping, middle, d, e)
      state = free_state(scene%form%damping, curve%free, d, e)
    end if
    call contact_series(scene, panel, state, c)
    call only_zero(sign*c, scene%form%panel(panel)%half, b, rest, settled, s, v)
    s = middle + s
    x = 0
    v = sign*v
    ! Near its beginning the arc's own series keeps more digits.
    settled = settled .and. s > reach(start_order)/scene%form%fastest
    found = settled .and. s <= to
  end subroutine only_release
end module lapwing_flow_exact_contact
