!> One arc in closed form against the differential equation in quadruple precision: near its
!> beginning and far from it, and the bound of what its Taylor polynomials leave out.
program test_smooth_curve
  use assertions, only: tally_t
  use exact_reference, only: qp, seed, uniform, chance, random_scene, quad_flow, &
      quad_acceleration, amplification, largest_term, scene_at_rest
  use lapwing_kinds, only: wp
  use lapwing_polynomial_evaluation, only: max_degree
  use lapwing_flank, only: locate_piece
  use lapwing_flow_exact_curve, only: scene_t, curve_t, begin_curve, expand_start, expand_fully
  use lapwing_flow_exact_motion, only: curve_at, curve_taylor, acceleration_at
  use lapwing_flow_exact_panels, only: locate_panel
  implicit none

  type(tally_t) :: tally
  real(wp), parameter :: eps = epsilon(1.0_wp)
  integer, parameter :: n_curves = 2000

  call seed(20261124)
  call test_motion()
  call test_small_bounce()
  call test_remainder()
  call tally%finish()

contains

  !> A random arc of a random scene.
  subroutine random_curve(number, scene, curve)
    integer, intent(in) :: number            !! decides what it is
    type(scene_t), intent(out) :: scene      !! scene
    type(curve_t), intent(out) :: curve      !! its series known
    logical :: contact, moving
    real(wp) :: t
    integer :: piece
    call random_scene(mod(number, 2) == 0, 0.5_wp, scene)
    contact = mod(number/2, 2) == 0
    moving = mod(number/4, 4) /= 0
    t = uniform(0.0_wp, scene%form%period)
    if (chance(0.1_wp)) t = 0
    piece = locate_piece(scene%flank, t, 1)
    if (chance(0.2_wp)) t = scene%flank%knot(piece)
    if (.not. moving) then
      scene = scene_at_rest(scene)
      piece = 1
    end if
    call begin_curve(scene, contact, t, piece, uniform(-2.0_wp, 2.0_wp), &
        uniform(-2.0_wp, 2.0_wp), curve)
    if (chance(0.5_wp)) then
      call expand_start(scene, curve)
    else
      call expand_fully(scene, curve)
    end if
  end subroutine random_curve

  !> Position and velocity by the equation, from a piece's beginning to time s of the arc, both
  !> before any kink.
  subroutine follow(scene, curve, s, x, v)
    type(scene_t), intent(in) :: scene       !! scene
    type(curve_t), intent(in) :: curve       !! arc
    real(wp), intent(in) :: s                !! time since its beginning
    real(qp), intent(out) :: x, v            !! position and velocity
    real(qp) :: t, ends
    integer :: piece
    x = curve%x
    v = curve%v
    t = curve%t
    piece = curve%piece
    ends = real(curve%t, qp) + s
    do
      if (ends <= scene%flank%knot(piece + 1) .or. piece == scene%flank%n) exit
      call quad_flow(scene, curve%contact, piece, t, &
          scene%flank%knot(piece + 1) - t, x, v)
      t = scene%flank%knot(piece + 1)
      piece = piece + 1
    end do
    call quad_flow(scene, curve%contact, piece, t, ends - t, x, v)
  end subroutine follow

  !> Time from an arc's beginning to the next kink or the end of the cycle.
  real(wp) function longest(scene, curve)
    type(scene_t), intent(in) :: scene       !! scene
    type(curve_t), intent(in) :: curve       !! arc
    longest = scene%flank%knot(scene%flank%next_kink(curve%piece)) - curve%t
  end function longest

  !> Rounding of a sum of response, free oscillation and force, or of a parabola and g.
  real(wp) function rounding(scene, curve, s)
    type(scene_t), intent(in) :: scene       !! scene
    type(curve_t), intent(in) :: curve       !! arc
    real(wp), intent(in) :: s                !! time
    real(wp) :: bend
    bend = 1 + largest_term(scene, 2)
    rounding = eps*(40*(abs(curve%x) + abs(curve%v) + 5)*(1 + abs(s))**2 &
        + (200 + 10*scene%form%n)*(bend + amplification(scene)))
  end function rounding

  subroutine test_motion()
    type(scene_t) :: scene
    type(curve_t) :: curve
    real(wp) :: s, x, v, allowed, worst
    real(qp) :: exact(2), a
    integer :: i, k, panel, near, far
    near = 0
    far = 0
    worst = 0
    do i = 1, n_curves
      call random_curve(i, scene, curve)
      do k = 0, 6
        s = longest(scene, curve)*(uniform(0.0_wp, 1.0_wp))
        if (k == 0) s = 0
        ! On either side of where the Taylor series gives way.
        if (k == 1) s = min(curve%near, longest(scene, curve))
        if (k == 2) s = min(nearest(curve%near, 1.0_wp), longest(scene, curve))
        if (k == 6) s = longest(scene, curve)
        panel = locate_panel(scene%form, curve%t + s)
        if (s > 0 .and. s >= longest(scene, curve)) panel = panel_that_ends(scene, panel, &
            curve%t + s)
        call curve_at(scene, curve, panel, s, x, v)
        call follow(scene, curve, s, exact(1), exact(2))
        allowed = rounding(scene, curve, s)
        call tally%near(x, real(exact(1), wp), allowed, "position")
        call tally%near(v, real(exact(2), wp), allowed, "velocity")
        worst = max(worst, abs(real(x - exact(1), wp))/allowed)
        if (s <= curve%near) near = near + 1
        if (s > curve%near) far = far + 1
        if (s >= longest(scene, curve)) cycle
        a = quad_acceleration(scene, curve%contact, scene%form%piece(panel), &
            real(curve%t, qp) + s, exact(1), exact(2))
        call tally%near(acceleration_at(scene, curve, panel, s, x, v), real(a, wp), &
            8*allowed, "acceleration")
      end do
    end do
    call tally%below(500.0_wp, real(min(near, far), wp), "both ways taken")
    print "(a, f6.3)", "measured: error of the position over what is allowed, at most ", worst
  end subroutine test_motion

  !> The panel that ends at a kink, not the one that begins there.
  integer function panel_that_ends(scene, panel, t)
    type(scene_t), intent(in) :: scene       !! scene
    integer, intent(in) :: panel             !! panel that holds t
    real(wp), intent(in) :: t                !! time in the cycle, a kink's to rounding
    panel_that_ends = panel
    if (panel == 1) return
    if (abs(t - scene%form%edge(panel)) <= 2*spacing(t)) panel_that_ends = panel - 1
  end function panel_that_ends

  !> A bounce of any size keeps its relative precision: x0 = 0 and s = 1e-3 ... 1e-12.
  subroutine test_small_bounce()
    type(scene_t) :: scene
    type(curve_t) :: curve
    real(wp) :: t, s, x, v, pull
    real(qp) :: exact(2)
    integer :: i, piece
    do i = 1, n_curves
      call random_scene(mod(i, 2) == 0, 0.5_wp, scene)
      t = uniform(0.0_wp, 0.99_wp)*scene%form%period
      piece = locate_piece(scene%flank, t, 1)
      s = 10.0_wp**uniform(-12.0_wp, -3.0_wp)
      if (t + s > scene%flank%knot(piece + 1)) cycle
      call begin_curve(scene, mod(i/2, 2) == 0, t, piece, 0.0_wp, s*uniform(-2.0_wp, 2.0_wp), &
          curve)
      call expand_fully(scene, curve)
      call curve_at(scene, curve, locate_panel(scene%form, t + s), s, x, v)
      exact = [0.0_qp, real(curve%v, qp)]
      call quad_flow(scene, curve%contact, piece, real(t, qp), real(s, qp), exact(1), &
          exact(2))
      ! t - knot rounds by EPS P, and so does the pull by that times its rate.
      pull = abs(scene%force) + 60*(1 + abs(scene%force))
      pull = pull + largest_term(scene, 2)*(1 + scene%form%period)**3
      call tally%near(x, real(exact(1), wp), 16*eps*(abs(curve%v) + pull*s)*s, "small excursion")
      call tally%near(v, real(exact(2), wp), 16*eps*(abs(curve%v) + pull*s), "its velocity")
    end do
  end subroutine test_small_bounce

  !> |x(s + h) - polynomial(h)| <= rest*h**6 to the end of the panel.
  subroutine test_remainder()
    type(scene_t) :: scene
    type(curve_t) :: curve
    real(wp) :: s, c(0:max_degree), rest, width, value, allowed, h, largest
    real(qp) :: x, v, begin(2)
    integer :: i, j, k, panel, edges
    logical :: at_edge
    edges = 0
    largest = 0
    do i = 1, n_curves
      call random_curve(i, scene, curve)
      s = min(longest(scene, curve), 3.0_wp)*uniform(0.0_wp, 0.98_wp)
      if (mod(i, 5) == 0) s = 0
      panel = locate_panel(scene%form, curve%t + s)
      ! From a panel's own beginning what is known beforehand is taken.
      at_edge = mod(i, 7) == 0 .and. scene%form%edge(panel) > curve%t
      if (at_edge) s = scene%form%edge(panel) - curve%t
      call curve_taylor(scene, curve, panel, at_edge, s, c, rest)
      if (at_edge) then
        edges = edges + 1
        call follow(scene, curve, s, begin(1), begin(2))
        call tally%near(c(0), real(begin(1), wp), rounding(scene, curve, s), "position at an edge")
        call tally%near(c(1), real(begin(2), wp), rounding(scene, curve, s), "velocity at an edge")
      end if
      width = scene%form%edge(panel + 1) - (curve%t + s)
      do j = 1, 4
        h = 0.25_wp*j*width
        x = c(0)
        v = c(1)
        call quad_flow(scene, curve%contact, scene%form%piece(panel), &
            real(curve%t, qp) + s, real(h, qp), x, v)
        value = 0
        do k = max_degree, 0, -1
          value = value*h + c(k)
        end do
        allowed = rounding(scene, curve, s)
        call tally%below(abs(real(x - value, wp)), rest*h**6 + allowed, &
            "what the Taylor polynomial leaves out")
        if (rest*h**6 > 100*allowed) largest = max(largest, &
            abs(real(x - value, wp))/(rest*h**6))
      end do
    end do
    print "(a, f6.3)", "measured: what is left out over its bound, at most ", largest
    call tally%below(50.0_wp, real(edges, wp), "beginnings of panels")
    ! No bound that is far too large either: it is nearly reached by one harmonic.
    call tally%below(0.2_wp, largest, "the bound is of use")
  end subroutine test_remainder
end program test_smooth_curve
