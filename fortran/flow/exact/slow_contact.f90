!> Contact in a graded scene: searched over panels that are long against the spring's own rates.
!>
!> x = F + q + d, q slow on a panel. As long as d lasts it is bounded, from any time on, by what is
!> left of it then (`lasting`): up to where F + q falls to that bound nothing can be met, and the
!> search goes there at once. Else it looks closely at a time that is short against d as it is.
module lapwing_flow_exact_slow_contact
  use lapwing_kinds, only: wp
  use lapwing_flow_exact_curve, only: scene_t, curve_t
  use lapwing_flow_exact_motion, only: curve_at
  use lapwing_flow_exact_panels, only: locate_panel, bound_order
  use lapwing_system_oscillation, only: lasting_t, lasting, n_taylor
  use lapwing_flow_exact_root_search, only: target_t, first_crossing, turn_after
  use lapwing_polynomial_evaluation, only: max_degree, taylor_shift, upper_bound
  use lapwing_polynomial_roots, only: first_zero
  implicit none
  private
  public :: slow_crossing, slow_turn, slow_farthest, panel_in_contact

  !> Close looks of one search; a contact that needs more goes on as a new arc.
  integer, parameter :: max_looks = 2000
  !> A close look lasts so many times what d takes to change by its own size.
  real(wp), parameter :: look_span = 16
  !> Far more than the rounding of a root.
  real(wp), parameter :: caution = 1 - 2.0_wp**(-20)

contains

  !> First crossing of a target between two times, or how far it was looked for.
  pure subroutine slow_crossing(scene, curve, goal, from, stop, panel, found, s)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve         !! arc
    type(target_t), intent(in) :: goal         !! what is looked for
    real(wp), intent(in) :: from, stop         !! times since the arc began
    integer, intent(inout) :: panel            !! panel that holds `from`; then s
    logical, intent(out) :: found              !! whether it is crossed
    real(wp), intent(out) :: s                 !! when; else nothing is met up to here
    type(target_t) :: here
    real(wp) :: to
    integer :: looks
    looks = 0
    here = goal
    s = from
    do
      to = min(scene%form%edge(panel + 1) - curve%t, stop)
      call cross_on_panel(scene, curve, panel, here, to, looks, found, s)
      if (found .or. s < to .or. to >= stop .or. panel == scene%form%n) exit
      here%touching = .false.
      panel = panel + 1
    end do
    ! What has come as far as it may is at its stop, not at an edge that rounding puts before it.
    if (.not. found .and. s >= to) s = stop
  end subroutine slow_crossing

  !> The same on one panel, from s on.
  pure subroutine cross_on_panel(scene, curve, panel, goal, to, looks, found, s)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve         !! arc
    integer, intent(in) :: panel
    type(target_t), intent(in) :: goal         !! what is looked for
    real(wp), intent(in) :: to                 !! latest time, on the panel
    integer, intent(inout) :: looks            !! close looks so far
    logical, intent(out) :: found              !! whether it is crossed
    real(wp), intent(inout) :: s               !! where to begin; then when it is met, or how far
    type(lasting_t) :: left
    type(target_t) :: here
    real(wp) :: safe, finish, at, x, v
    found = .false.
    here = goal
    do while (looks < max_looks .and. s < to)
      left = lasting(scene%form%damping, curve%free, s)
      if (.not. here%touching) then
        safe = safe_time(scene, curve, panel, here, left, s, to)
        s = min(s + safe, to)
        if (s >= to) return
        if (safe > 0) left = lasting(scene%form%damping, curve%free, s)
      end if
      finish = to
      if (left%sixth > 0) finish = min(to, s + look_span*(left%x/left%sixth)**(1.0_wp/6))
      call first_crossing(scene, curve, panel, .false., here, s, finish, found, at, x, v)
      looks = looks + 1
      s = at
      if (found) return
      s = finish
      here%touching = .false.
    end do
  end subroutine cross_on_panel

  !> Time for which nothing can be met: what is slow stays farther away than what is left of d.
  pure real(wp) function safe_time(scene, curve, panel, goal, left, s, to) result(safe)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve         !! arc
    integer, intent(in) :: panel
    type(target_t), intent(in) :: goal         !! what is looked for
    type(lasting_t), intent(in) :: left        !! what is left of d at s
    real(wp), intent(in) :: s, to              !! from when, and at most until when
    real(wp) :: c(0:max_degree), rest
    logical :: met
    call slow_part(scene, curve, panel, s, goal%turn, c, rest)
    c = goal%sign*c
    if (.not. goal%turn) c(0) = c(0) - goal%sign*goal%wall
    c(0) = c(0) - merge(left%v, left%x, goal%turn) - rest*(to - s)**merge(max_degree, bound_order, &
        goal%turn)
    safe = 0
    if (.not. c(0) > 0) return
    call first_zero(c, to - s, met, safe)
    if (met) safe = caution*safe
  end function safe_time

  !> Taylor coefficients of F + q, or of q', about a time, and a bound of what they leave out per
  !> power of time.
  pure subroutine slow_part(scene, curve, panel, s, rate, c, rest)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve         !! arc
    integer, intent(in) :: panel
    real(wp), intent(in) :: s                  !! time since the arc began
    logical, intent(in) :: rate                !! whether it is q'
    real(wp), intent(out) :: c(0:max_degree)   !! coefficients
    real(wp), intent(out) :: rest              !! bound
    real(wp) :: q(0:n_taylor)
    integer :: k
    q = scene%form%panel(panel)%q
    call taylor_shift(q, curve%t + s - scene%form%panel(panel)%middle)
    rest = scene%form%panel(panel)%q_sixth
    if (rate) then
      c = [(k*q(k), k = 1, max_degree), 0.0_wp]
      rest = bound_order*rest
    else
      c = q(0:max_degree)
      c(0) = c(0) + scene%force
    end if
  end subroutine slow_part

  !> Panel that holds a time of an arc. In a contact that stops at its knot, as in a graded scene
  !> with a table, the one that ends there: the next one's q is another.
  pure integer function panel_in_contact(scene, curve, s) result(panel)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve         !! arc
    real(wp), intent(in) :: s                  !! time since it began
    panel = locate_panel(scene%form, curve%t + s)
    if (.not. scene%form%graded .or. .not. curve%contact) return
    do while (panel > 1 .and. scene%form%piece(panel) > curve%piece)
      panel = panel - 1
    end do
  end function panel_in_contact

  !> First time after `from` where the velocity changes sign.
  pure subroutine slow_turn(scene, curve, at_turn, from, until, found, s)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve         !! arc
    logical, intent(in) :: at_turn             !! whether `from` is such a time
    real(wp), intent(in) :: from, until        !! times since its beginning
    logical, intent(out) :: found              !! whether there is one
    real(wp), intent(out) :: s                 !! when
    type(target_t) :: goal
    real(wp) :: begin
    integer :: panel
    begin = from
    do
      panel = panel_in_contact(scene, curve, begin)
      goal = turn_after(scene, curve, panel, at_turn .and. begin == from, begin)
      call slow_crossing(scene, curve, goal, begin, until, panel, found, s)
      found = found .and. s > from .and. s < until
      if (found .or. s >= until) return
      begin = s
    end do
  end subroutine slow_turn

  !> Largest sign*x over an arc, if it exceeds `least`; else `least`. Turn by turn, until what is
  !> slow and what is left of d cannot exceed the largest found.
  pure real(wp) function slow_farthest(scene, curve, sign, until, least) result(most)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve         !! arc
    real(wp), intent(in) :: sign               !! +1: the largest x, -1: the smallest
    real(wp), intent(in) :: until              !! end of the arc
    real(wp), intent(in) :: least              !! value known already
    real(wp) :: begin, s, x, v
    logical :: found
    call curve_at(scene, curve, panel_in_contact(scene, curve, until), until, x, v)
    most = max(least, sign*curve%x, sign*x)
    s = 0
    do while (highest(scene, curve, sign, s, until) > most)
      begin = s
      call slow_turn(scene, curve, begin > 0, begin, until, found, s)
      if (.not. found) return
      call curve_at(scene, curve, panel_in_contact(scene, curve, s), s, x, v)
      most = max(most, sign*x)
    end do
  end function slow_farthest

  !> Upper bound of sign*x between two times.
  pure real(wp) function highest(scene, curve, sign, from, until)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve         !! arc
    real(wp), intent(in) :: sign               !! +1 or -1
    real(wp), intent(in) :: from, until        !! times since it began
    type(lasting_t) :: left
    real(wp) :: c(0:max_degree), rest, begin, finish
    integer :: panel
    panel = panel_in_contact(scene, curve, from)
    begin = from
    highest = -huge(highest)
    do
      finish = min(scene%form%edge(panel + 1) - curve%t, until)
      call slow_part(scene, curve, panel, begin, .false., c, rest)
      highest = max(highest, upper_bound(sign*c, finish - begin) &
          + rest*(finish - begin)**bound_order)
      if (finish >= until .or. panel == scene%form%n) exit
      begin = finish
      panel = panel + 1
    end do
    left = lasting(scene%form%damping, curve%free, from)
    highest = highest + left%x
  end function highest
end module lapwing_flow_exact_slow_contact
