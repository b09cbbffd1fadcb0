!> One smooth arc as a curve: where it begins, and its Taylor series about there.
!>
!> Position x and velocity v refer to the flank the arc is seen from: the flank last touched in
!> flight, the flank in contact. In flight x = x0 + v0 s + F s**2/2 less what the flank does; in
!> contact x = F + q + d (`lapwing_flow_exact_panels`). Near the beginning both are taken from their
!> Taylor series, so that the smallest bounce keeps its relative precision.
module lapwing_flow_exact_curve
  use lapwing_kinds, only: wp
  use lapwing_flank, only: flank_t
  use lapwing_flank_series, only: series_flank_t, turn_series, turned_value, turned_taylor, &
      turned_tail
  use lapwing_flank_table, only: te_table_t
  use lapwing_flow, only: curve_t, start_order
  use lapwing_flow_exact_interval_bounds, only: blocks_t
  use lapwing_flow_exact_panels, only: closed_form_t, response_at, reach
  use lapwing_polynomial_evaluation, only: max_degree
  implicit none
  private
  public :: curve_t, scene_t, begin_curve, expand_start, expand_fully, expand_over, &
      motion_taylor, is_smooth

  !> 1/(k (k - 1)) for k from 2 on: two integrations of a power.
  real(wp), parameter :: over_pairs(2:start_order) = 1/[2.0_wp, 6.0_wp, 12.0_wp, 20.0_wp, &
      30.0_wp, 42.0_wp, 56.0_wp, 72.0_wp, 90.0_wp, 110.0_wp, 132.0_wp, 156.0_wp]

  !> What all arcs seen from one flank have in common.
  type :: scene_t
    real(wp) :: force = 1                 !! F
    class(flank_t), pointer :: flank => null()     !! its motion g, the system's own
    type(closed_form_t) :: form           !! what is computed beforehand
    type(blocks_t) :: blocks              !! and bounded together, where there is much of it
    real(wp), allocatable :: bend(:)      !! -g''/2 of each piece, where all are parabolas and few
  end type scene_t

contains

  !> Begin an arc.
  pure subroutine begin_curve(scene, contact, t, piece, x, v, curve)
    type(scene_t), intent(in) :: scene
    logical, intent(in) :: contact             !! in contact, or in flight
    real(wp), intent(in) :: t                  !! time in the cycle
    integer, intent(in) :: piece               !! piece of the flank that holds t
    real(wp), intent(in) :: x, v               !! position and velocity
    type(curve_t), intent(inout) :: curve      !! the arc; not `out`, which would fill it twice
    real(wp) :: q(2)
    curve%near = -1
    curve%degree = -1
    curve%is_turned = .false.
    curve%contact = contact
    curve%t = t
    curve%piece = piece
    curve%x = x
    curve%v = v
    if (.not. contact) return
    select type (flank => scene%flank)
    type is (series_flank_t)
      call turn_series(flank%series, t, curve%turned)
      curve%is_turned = .true.
      call turned_value(scene%form%q, curve%turned, q(1), q(2))
    class default
      q = response_at(scene%form, t)
    end select
    curve%free = [(x - scene%force) - q(1), v - q(2)]
  end subroutine begin_curve

  !> The Taylor series of an arc about its beginning, and how far it reaches: as many terms as a
  !> quick return needs, if there might be one.
  pure subroutine expand_start(scene, curve)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(inout) :: curve      !! its series is set
    real(wp) :: most
    integer :: n
    call expand_shortly(scene, curve)
    if (.not. goes_on(scene, curve)) return
    if (curve%v*curve%taylor(2) >= 0) return
    ! Twice as far as the return of a parabola lies: see `quick_return`.
    most = 1.5_wp*abs(curve%v)*fastest(scene, curve)
    if (most > reach(start_order)*abs(curve%taylor(2))) return
    do n = max_degree, start_order - 2, 2
      if (most <= reach(n)*abs(curve%taylor(2))) exit
    end do
    if (n > max_degree) call expand_up_to(scene, curve, n)
  end subroutine expand_start

  !> The Taylor series with all its terms.
  pure subroutine expand_fully(scene, curve)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(inout) :: curve      !! its series is set
    if (curve%near < 0) call expand_shortly(scene, curve)
    if (goes_on(scene, curve)) call expand_up_to(scene, curve, start_order)
  end subroutine expand_fully

  !> As many terms as reach over an arc of a length; in flight six, where none do.
  pure subroutine expand_over(scene, curve, length)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(inout) :: curve      !! its series is set
    real(wp), intent(in) :: length             !! of the arc
    integer :: n
    if (curve%contact) then
      call expand_fully(scene, curve)
      return
    end if
    if (curve%near < 0) call expand_shortly(scene, curve)
    if (.not. goes_on(scene, curve)) return
    do n = max_degree + 2, start_order, 2
      if (length <= curve%near) return
      if (length*fastest(scene, curve) > reach(n)) cycle
      call expand_up_to(scene, curve, n)
    end do
  end subroutine expand_over

  !> Whether the flank's motion is a series, smooth throughout the period.
  pure logical function is_smooth(flank)
    class(flank_t), intent(in) :: flank
    select type (flank)
    type is (series_flank_t)
      is_smooth = .true.
    class default
      is_smooth = .false.
    end select
  end function is_smooth

  !> Whether an arc's series goes on after the sixth term.
  pure logical function goes_on(scene, curve)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve         !! arc
    goes_on = curve%contact .or. is_smooth(scene%flank)
  end function goes_on

  !> The first six terms, and how far they reach.
  pure subroutine expand_shortly(scene, curve)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(inout) :: curve      !! its series is set
    real(wp) :: g(0:max_degree)
    select type (flank => scene%flank)
    type is (series_flank_t)
      if (.not. curve%is_turned) call turn_series(flank%series, curve%t, curve%turned)
      curve%is_turned = .true.
      call turned_taylor(flank%series, curve%turned, g)
    class default
      call flank%taylor(curve%piece, curve%t, g)
    end select
    curve%flank = g(0:1)
    call motion_taylor(scene, curve%contact, curve%x, curve%v, g, curve%taylor)
    curve%degree = max_degree
    call set_reach(scene, curve)
  end subroutine expand_shortly

  !> More terms, up to an odd order.
  pure subroutine expand_up_to(scene, curve, n)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(inout) :: curve      !! its series is continued
    integer, intent(in) :: n                   !! order
    real(wp) :: g(0:start_order)
    integer :: k
    if (curve%degree >= n) return
    select type (flank => scene%flank)
    type is (series_flank_t)
      call turned_tail(flank%series, curve%turned, curve%degree + 1, n, g)
    class default
      g = 0
    end select
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
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(inout) :: curve      !! its reach is set
    curve%near = huge(1.0_wp)
    if (goes_on(scene, curve)) curve%near = reach(curve%degree)/fastest(scene, curve)
    select type (flank => scene%flank)
    type is (te_table_t)
      curve%near = min(curve%near, flank%knot(curve%piece + 1) - curve%t)
    end select
  end subroutine set_reach

  !> Rate that bounds the reach of an arc's series.
  pure real(wp) function fastest(scene, curve)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve         !! arc
    fastest = scene%form%fastest
    if (.not. curve%contact) fastest = scene%form%fastest_in_flight
  end function fastest

  !> Taylor coefficients of the motion from position and velocity: x'' = F - g'' in flight,
  !> x'' = F - g'' - 2 xi x' - x in contact.
  pure subroutine motion_taylor(scene, contact, x, v, g, c)
    type(scene_t), intent(in) :: scene
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
end module lapwing_flow_exact_curve
