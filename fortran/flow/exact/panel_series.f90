!> The motion over a panel as one Taylor series about its middle, exact to rounding: no sines, no
!> exponentials. And what a flight is where no series is needed: over a table piece, and at most.
module lapwing_flow_exact_panel_series
  use lapwing_kinds, only: wp
  use lapwing_flow_exact_oscillation, only: near_matrix, n_taylor
  use lapwing_polynomial_evaluation, only: max_degree
  use lapwing_flow_exact_motion, only: scene_t, curve_t
  implicit none
  private
  public :: free_in_middle, contact_series, flight_series, flight_on_piece, range_of_flight

contains

  !> d and d' in the middle of the panel that holds the launch, which may lie before it.
  pure function free_in_middle(scene, curve, panel) result(free)
    type(scene_t), intent(in) :: scene             !! scene
    type(curve_t), intent(in) :: curve             !! arc
    integer, intent(in) :: panel                   !! panel
    real(wp) :: free(2), matrix(2, 2)
    matrix = near_matrix(scene%form%damping, scene%form%panel(panel)%middle - curve%t)
    free = matrix(:, 1)*curve%free(1) + matrix(:, 2)*curve%free(2)
  end function free_in_middle

  !> Taylor series of x about a panel's middle in contact, exact to rounding over the panel.
  pure subroutine contact_series(scene, moving, panel, free, c)
    type(scene_t), intent(in) :: scene             !! scene
    logical, intent(in) :: moving                  !! whether the flank moves with g
    integer, intent(in) :: panel                   !! panel
    real(wp), intent(in) :: free(2)                !! d and d' in its middle
    real(wp), intent(out) :: c(0:n_taylor)         !! coefficients
    associate (unit => scene%form%damping%unit)
      c = unit(:, 1)*free(1) + unit(:, 2)*free(2)
    end associate
    if (moving) c = c + scene%form%panel(panel)%q
    c(0) = c(0) + scene%force
  end subroutine contact_series

  !> The same, of sign*(x - wall), in a flight over a series.
  pure subroutine flight_series(scene, curve, panel, sign, wall, c)
    type(scene_t), intent(in) :: scene             !! scene
    type(curve_t), intent(in) :: curve             !! arc
    integer, intent(in) :: panel                   !! panel
    real(wp), intent(in) :: sign                   !! +1 or -1
    real(wp), intent(in) :: wall                   !! position
    real(wp), intent(out) :: c(0:n_taylor)         !! coefficients
    real(wp) :: s, rate
    associate (here => scene%form%panel(panel))
      s = here%middle - curve%t
      rate = curve%v + curve%flank(2)
      c = -sign*here%g
      c(0) = sign*((curve%x - wall) + (rate + 0.5_wp*scene%force*s)*s &
          - (here%g(0) - curve%flank(1)))
      c(1) = sign*(rate + scene%force*s - here%g(1))
      c(2) = sign*(0.5_wp*scene%force - here%g(2))
    end associate
  end subroutine flight_series

  !> Position in a flight on a table piece, about its knot, from position and velocity there.
  pure function flight_on_piece(scene, piece, x, v) result(c)
    type(scene_t), intent(in) :: scene             !! scene
    integer, intent(in) :: piece                   !! piece
    real(wp), intent(in) :: x, v                   !! position and velocity, after any jump
    real(wp) :: c(0:max_degree)
    c = -scene%table%coefficient(:, piece)
    c(0) = x
    c(1) = v
    c(2) = c(2) + 0.5_wp*scene%force
  end function flight_on_piece

  !> Least and greatest theta of a flight between two times: a parabola lies on one side of its
  !> chord, no farther from it than acceleration*duration**2/8.
  pure subroutine range_of_flight(scene, curve, begin, finish, low, high)
    type(scene_t), intent(in) :: scene             !! scene
    type(curve_t), intent(in) :: curve             !! arc
    real(wp), intent(in) :: begin, finish          !! times since it began
    real(wp), intent(out) :: low, high             !! bounds of x + g
    real(wp) :: first, last, rate, sag
    rate = curve%v + curve%flank(2)
    first = (curve%x + curve%flank(1)) + (rate + 0.5_wp*scene%force*begin)*begin
    last = (curve%x + curve%flank(1)) + (rate + 0.5_wp*scene%force*finish)*finish
    sag = 0.125_wp*scene%force*(finish - begin)**2
    low = min(first, last) - max(sag, 0.0_wp)
    high = max(first, last) - min(sag, 0.0_wp)
  end subroutine range_of_flight
end module lapwing_flow_exact_panel_series
