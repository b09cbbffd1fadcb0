!> One smooth arc in closed form: where the tooth is at any time of it.
!>
!> Position x and velocity v refer to the flank the arc is told from: the flank last touched in
!> flight, the flank in contact. In flight x = x0 + v0 s + F s**2/2 less what the flank does; in
!> contact x = F + q + d (`lapwing_flow_exact_response`). Near the beginning both are taken from
!> their Taylor series, so that the smallest bounce keeps its relative precision.
module lapwing_flow_exact_motion
  use lapwing_kinds, only: wp
  use lapwing_flow_exact_interval_bounds, only: blocks_t
  use lapwing_flow_exact_response, only: closed_form_t, panel_t, locate_panel, free_size, &
      launch_order, reach
  use lapwing_flow_exact_oscillation, only: free_after, lasting, lasting_t, n_taylor
  use lapwing_flank_series, only: turned_t, turn_series, turned_value, turned_taylor, turned_tail, &
      series_at, expand_series
  use lapwing_polynomial_evaluation, only: max_degree, horner, horner_slope, jet, taylor_shift
  use lapwing_flank_table, only: te_table_t
  implicit none
  private
  public :: curve_t, scene_t, launch, expand_launch, expand_fully, curve_at, curve_taylor
  public :: flank_taylor, rest_after, acceleration_at, fly_from

  !> 1/(k (k - 1)) for k from 2 on: two integrations of a power.
  real(wp), parameter :: over_pairs(2:launch_order) = 1/[2.0_wp, 6.0_wp, 12.0_wp, 20.0_wp, &
      30.0_wp, 42.0_wp, 56.0_wp, 72.0_wp, 90.0_wp, 110.0_wp, 132.0_wp, 156.0_wp]

  !> What all arcs of an oscillator have in common.
  type :: scene_t
    real(wp) :: force = 1                 !! F
    type(te_table_t), pointer :: table => null()   !! g as a table, the system's own
    type(closed_form_t) :: form           !! what is computed beforehand
    type(blocks_t) :: blocks              !! and bounded together, where there is much of it
  end type scene_t

  !> One arc.
  type :: curve_t
    logical :: contact = .false.          !! in contact, or in flight
    logical :: moving = .true.            !! whether the flank moves with g
    integer :: degree = -1                !! of its series, as far as it is known
    integer :: piece = 1                  !! table piece of the beginning
    real(wp) :: t = 0                     !! cycle time of s = 0
    real(wp) :: x = 0, v = 0              !! position and velocity there
    real(wp) :: near = -1                 !! the Taylor series holds up to this s
    real(wp) :: taylor(0:launch_order)    !! of x about s = 0, once expanded
    real(wp) :: flank(2) = 0              !! g and g' at s = 0, in flight
    real(wp) :: free(2) = 0               !! d and d' at s = 0, in contact
    logical :: is_turned = .false.        !! whether the series' terms at s = 0 are known
    type(turned_t) :: turned              !! those
  end type curve_t

contains

  !> Begin an arc.
  pure subroutine launch(scene, contact, moving, t, piece, x, v, curve)
    type(scene_t), intent(in) :: scene         !! scene
    logical, intent(in) :: contact             !! in contact, or in flight
    logical, intent(in) :: moving              !! whether the flank moves with g
    real(wp), intent(in) :: t                  !! time in the cycle
    integer, intent(in) :: piece               !! table piece that holds t
    real(wp), intent(in) :: x, v               !! position and velocity
    type(curve_t), intent(inout) :: curve      !! the arc; not `out`, which would fill it twice
    real(wp) :: q(2)
    curve%near = -1
    curve%degree = -1
    curve%is_turned = .false.
    curve%contact = contact
    curve%moving = moving
    curve%t = t
    curve%piece = piece
    curve%x = x
    curve%v = v
    if (.not. contact) return
    q = 0
    if (moving .and. scene%form%harmonic) then
      call turn_series(scene%form%g, t, curve%turned)
      curve%is_turned = .true.
      call turned_value(scene%form%q, curve%turned, q(1), q(2))
    else if (moving) then
      q = response_at(scene, t)
    end if
    curve%free = [(x - scene%force) - q(1), v - q(2)]
  end subroutine launch

  !> q and q' at a time of the cycle, after what happens there.
  pure function response_at(scene, t) result(q)
    type(scene_t), intent(in) :: scene         !! scene
    real(wp), intent(in) :: t                  !! time in the cycle
    real(wp) :: q(2)
    integer :: panel
    panel = locate_panel(scene%form, t)
    if (t == scene%form%edge(panel)) then
      q = scene%form%panel(panel)%q_begin
    else
      q = response_on(scene%form%panel(panel), t)
    end if
  end function response_at

  !> q and q' at a time within a panel.
  pure function response_on(panel, t) result(q)
    type(panel_t), intent(in) :: panel         !! panel
    real(wp), intent(in) :: t                  !! time in the cycle
    real(wp) :: q(2), bend
    call jet(n_taylor, panel%q, t - panel%middle, q(1), q(2), bend)
  end function response_on

  !> The Taylor series of an arc about its beginning, and how far it reaches: as many terms as a
  !> quick return needs, if there might be one.
  pure subroutine expand_launch(scene, curve)
    type(scene_t), intent(in) :: scene         !! scene
    type(curve_t), intent(inout) :: curve      !! its series is set
    real(wp) :: most
    integer :: n
    call expand_shortly(scene, curve)
    if (.not. goes_on(scene, curve)) return
    if (curve%v*curve%taylor(2) >= 0) return
    ! Twice as far as the return of a parabola lies: see `quick_return`.
    most = 1.5_wp*abs(curve%v)*fastest(scene, curve)
    if (most > reach(launch_order)*abs(curve%taylor(2))) return
    do n = max_degree, launch_order - 2, 2
      if (most <= reach(n)*abs(curve%taylor(2))) exit
    end do
    if (n > max_degree) call expand_up_to(scene, curve, n)
  end subroutine expand_launch

  !> The Taylor series with all its terms.
  pure subroutine expand_fully(scene, curve)
    type(scene_t), intent(in) :: scene         !! scene
    type(curve_t), intent(inout) :: curve      !! its series is set
    if (curve%near < 0) call expand_shortly(scene, curve)
    if (goes_on(scene, curve)) call expand_up_to(scene, curve, launch_order)
  end subroutine expand_fully

  !> Whether an arc's series goes on after the sixth term.
  pure logical function goes_on(scene, curve)
    type(scene_t), intent(in) :: scene         !! scene
    type(curve_t), intent(in) :: curve         !! arc
    goes_on = curve%contact .or. (scene%form%harmonic .and. curve%moving)
  end function goes_on

  !> The first six terms, and how far they reach.
  pure subroutine expand_shortly(scene, curve)
    type(scene_t), intent(in) :: scene         !! scene
    type(curve_t), intent(inout) :: curve      !! its series is set
    real(wp) :: g(0:max_degree)
    if (scene%form%harmonic .and. curve%moving) then
      if (.not. curve%is_turned) call turn_series(scene%form%g, curve%t, curve%turned)
      curve%is_turned = .true.
      call turned_taylor(scene%form%g, curve%turned, g)
    else
      call flank_taylor(scene, curve%moving, curve%t, curve%piece, g)
    end if
    curve%flank = g(0:1)
    call motion_taylor(scene, curve%contact, curve%x, curve%v, g, curve%taylor)
    curve%degree = max_degree
    call set_reach(scene, curve)
  end subroutine expand_shortly

  !> More terms, up to an odd order.
  pure subroutine expand_up_to(scene, curve, n)
    type(scene_t), intent(in) :: scene         !! scene
    type(curve_t), intent(inout) :: curve      !! its series is continued
    integer, intent(in) :: n                   !! order
    real(wp) :: g(0:launch_order)
    integer :: k
    if (curve%degree >= n) return
    if (scene%form%harmonic .and. curve%moving) then
      call turned_tail(scene%form%g, curve%turned, curve%degree + 1, n, g)
    else
      g = 0
    end if
    associate (c => curve%taylor)
      do k = curve%degree + 1, n
        c(k) = -g(k)
        if (curve%contact) c(k) = c(k) &
            - (2*scene%form%damping%xi*(k - 1)*c(k - 1) + c(k - 2))*over_pairs(k)
      end do
    end associate
    curve%degree = n
    call set_reach(scene, curve)
  end subroutine expand_up_to

  !> How far an arc's series reaches.
  pure subroutine set_reach(scene, curve)
    type(scene_t), intent(in) :: scene         !! scene
    type(curve_t), intent(inout) :: curve      !! its reach is set
    curve%near = huge(1.0_wp)
    if (goes_on(scene, curve)) curve%near = reach(curve%degree)/fastest(scene, curve)
    if (scene%form%harmonic .or. .not. curve%moving) return
    curve%near = min(curve%near, to_knot(scene, curve))
  end subroutine set_reach

  !> Rate that bounds the reach of an arc's series.
  pure real(wp) function fastest(scene, curve)
    type(scene_t), intent(in) :: scene         !! scene
    type(curve_t), intent(in) :: curve         !! arc
    fastest = scene%form%fastest
    if (.not. curve%contact) fastest = scene%form%fastest_in_flight
  end function fastest

  pure real(wp) function to_knot(scene, curve)
    type(scene_t), intent(in) :: scene         !! scene
    type(curve_t), intent(in) :: curve         !! arc
    to_knot = scene%table%knot(curve%piece + 1) - curve%t
  end function to_knot

  !> Taylor coefficients of g about t: a table's own, or those of the series.
  pure subroutine flank_taylor(scene, moving, t, piece, g)
    type(scene_t), intent(in) :: scene         !! scene
    logical, intent(in) :: moving              !! whether the flank moves with g
    real(wp), intent(in) :: t                  !! time in the cycle
    integer, intent(in) :: piece               !! table piece that holds t
    real(wp), intent(out) :: g(0:)             !! coefficients
    g = 0
    if (.not. moving) return
    if (scene%form%harmonic) then
      call expand_series(scene%form%g, t, ubound(g, 1), g)
    else
      g(0:max_degree) = scene%table%coefficient(:, piece)
      if (t /= scene%table%knot(piece)) then
        call taylor_shift(g(0:max_degree), t - scene%table%knot(piece))
      end if
    end if
  end subroutine flank_taylor

  !> Taylor coefficients of the motion from position and velocity: x'' = F - g'' in flight,
  !> x'' = F - g'' - 2 xi x' - x in contact.
  pure subroutine motion_taylor(scene, contact, x, v, g, c)
    type(scene_t), intent(in) :: scene             !! scene
    logical, intent(in) :: contact                 !! in contact, or in flight
    real(wp), intent(in) :: x, v                   !! position and velocity
    real(wp), intent(in) :: g(0:max_degree)        !! Taylor coefficients of the flank
    real(wp), intent(out) :: c(0:max_degree)       !! and of the motion
    real(wp) :: double_xi
    integer :: k
    c = -g
    c(0) = x
    c(1) = v
    c(2) = c(2) + 0.5_wp*scene%force
    if (.not. contact) return
    double_xi = 2*scene%form%damping%xi
    do k = 2, max_degree
      c(k) = c(k) - (double_xi*(k - 1)*c(k - 1) + c(k - 2))*over_pairs(k)
    end do
  end subroutine motion_taylor

  !> Position and velocity at s. `panel` holds t + s; at its end the values before any jump.
  pure subroutine curve_at(scene, curve, panel, s, x, v)
    type(scene_t), intent(in) :: scene         !! scene
    type(curve_t), intent(in) :: curve         !! arc
    integer, intent(in) :: panel               !! panel (in contact, with a table)
    real(wp), intent(in) :: s                  !! time since its beginning
    real(wp), intent(out) :: x, v              !! position and velocity
    real(wp) :: g, slope
    if (s <= curve%near) then
      x = horner(curve%taylor(0:curve%degree), s)
      v = horner_slope(curve%taylor(0:curve%degree), s)
    else if (curve%contact) then
      call contact_at(scene, curve, panel, s, x, v)
    else
      call flank_at(scene, panel, curve%t + s, g, slope)
      call fly_from(scene, curve, s, g, slope, x, v)
    end if
  end subroutine curve_at

  !> g and g' at a time of the cycle.
  pure subroutine flank_at(scene, panel, t, g, slope)
    type(scene_t), intent(in) :: scene         !! scene
    integer, intent(in) :: panel               !! panel that holds t
    real(wp), intent(in) :: t                  !! time in the cycle
    real(wp), intent(out) :: g, slope          !! position and velocity
    real(wp) :: x
    integer :: piece
    if (scene%form%harmonic) then
      call series_at(scene%form%g, t, g, slope)
    else
      piece = scene%form%piece(panel)
      x = t - scene%table%knot(piece)
      g = horner(scene%table%coefficient(:, piece), x)
      slope = horner_slope(scene%table%coefficient(:, piece), x)
    end if
  end subroutine flank_at

  !> The same in contact: F + q + d.
  pure subroutine contact_at(scene, curve, panel, s, x, v)
    type(scene_t), intent(in) :: scene         !! scene
    type(curve_t), intent(in) :: curve         !! arc
    integer, intent(in) :: panel               !! panel that holds t + s
    real(wp), intent(in) :: s                  !! time since its beginning
    real(wp), intent(out) :: x, v              !! position and velocity
    real(wp) :: q(2)
    associate (form => scene%form)
      q = 0
      if (curve%moving) then
        if (curve%t + s >= form%edge(panel + 1)) then
          q = form%panel(panel)%q_end
        else
          q = response_on(form%panel(panel), curve%t + s)
        end if
      end if
      call add_free_part(scene, curve, s, q, x, v)
    end associate
  end subroutine contact_at

  !> Taylor coefficients of the motion about s, and a bound of |x^(6)|/6! from there on: within the
  !> panel, which holds t + s, or begins there.
  pure subroutine curve_taylor(scene, curve, panel, at_edge, s, c, rest)
    type(scene_t), intent(in) :: scene             !! scene
    type(curve_t), intent(in) :: curve             !! arc
    integer, intent(in) :: panel                   !! panel
    logical, intent(in) :: at_edge                 !! whether it begins at s
    real(wp), intent(in) :: s                      !! time since the arc began
    real(wp), intent(out) :: c(0:max_degree)       !! coefficients
    real(wp), intent(out) :: rest                  !! bound
    real(wp) :: g(0:max_degree), q(2), x, v
    type(turned_t) :: turned
    if (.not. scene%form%harmonic .or. .not. curve%moving) then
      call curve_at(scene, curve, panel, s, x, v)
      call flank_taylor(scene, curve%moving, curve%t + s, scene%form%piece(panel), g)
    else
      ! The same sines serve g, its derivatives and q.
      if (at_edge) then
        g = scene%form%g_taylor(:, panel)
        q = scene%form%panel(panel)%q_begin
      else
        call turn_series(scene%form%g, curve%t + s, turned)
        call turned_taylor(scene%form%g, turned, g)
        if (curve%contact) call turned_value(scene%form%q, turned, q(1), q(2))
      end if
      if (s <= curve%near) then
        call curve_at(scene, curve, panel, s, x, v)
      else if (curve%contact) then
        call add_free_part(scene, curve, s, q, x, v)
      else
        call fly_from(scene, curve, s, g(0), g(1), x, v)
      end if
    end if
    call motion_taylor(scene, curve%contact, x, v, g, c)
    rest = rest_after(scene, curve, panel, s)
  end subroutine curve_taylor

  !> Position and velocity in flight where the flank is known.
  pure subroutine fly_from(scene, curve, s, g, slope, x, v)
    type(scene_t), intent(in) :: scene             !! scene
    type(curve_t), intent(in) :: curve             !! arc
    real(wp), intent(in) :: s                      !! time since it began
    real(wp), intent(in) :: g, slope               !! flank's position and velocity
    real(wp), intent(out) :: x, v                  !! position and velocity
    real(wp) :: rate
    rate = curve%v + curve%flank(2)
    x = curve%x + (rate + 0.5_wp*scene%force*s)*s - (g - curve%flank(1))
    v = rate + scene%force*s - slope
  end subroutine fly_from

  !> Position and velocity in contact where the response is known.
  pure subroutine add_free_part(scene, curve, s, q, x, v)
    type(scene_t), intent(in) :: scene             !! scene
    type(curve_t), intent(in) :: curve             !! arc
    real(wp), intent(in) :: s                      !! time since it began
    real(wp), intent(in) :: q(2)                   !! response and its rate
    real(wp), intent(out) :: x, v                  !! position and velocity
    real(wp) :: state(2)
    state = free_after(scene%form%damping, curve%free, s, scene%form%graded)
    x = scene%force + (q(1) + state(1))
    v = q(2) + state(2)
  end subroutine add_free_part

  !> Bound of |x^(6)|/6! on a panel from a time on: of q, and of a free oscillation that never
  !> grows, and in a graded scene may have died out by then.
  pure real(wp) function rest_after(scene, curve, panel, s) result(rest)
    type(scene_t), intent(in) :: scene             !! scene
    type(curve_t), intent(in) :: curve             !! arc
    integer, intent(in) :: panel                   !! panel
    real(wp), intent(in) :: s                      !! time since the arc began
    type(lasting_t) :: left
    rest = 0
    if (curve%contact) then
      if (scene%form%graded) then
        left = lasting(scene%form%damping, curve%free, s)
        rest = left%sixth
      else
        rest = scene%form%free_bound*free_size(curve%free)
      end if
      if (curve%moving) rest = rest + scene%form%panel(panel)%q_sixth
    else if (scene%form%harmonic .and. curve%moving) then
      rest = scene%form%g_bound
    end if
  end function rest_after

  !> x'' where position and velocity are known.
  pure real(wp) function acceleration_at(scene, curve, panel, s, x, v) result(a)
    type(scene_t), intent(in) :: scene             !! scene
    type(curve_t), intent(in) :: curve             !! arc
    integer, intent(in) :: panel                   !! panel that holds t + s
    real(wp), intent(in) :: s                      !! time since its beginning
    real(wp), intent(in) :: x, v                   !! position and velocity there
    real(wp) :: g(0:max_degree)
    call flank_taylor(scene, curve%moving, curve%t + s, scene%form%piece(panel), g)
    a = scene%force - 2*g(2)
    if (curve%contact) a = a - 2*scene%form%damping%xi*v - x
  end function acceleration_at
end module lapwing_flow_exact_motion
