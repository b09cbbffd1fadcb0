!> Where the tooth is at any time of an arc in closed form: at a time, as a Taylor polynomial about
!> one, as one series over a panel.
module lapwing_flow_exact_motion
  use lapwing_kinds, only: wp
  use lapwing_flank_series, only: series_flank_t, turned_t, turn_series, turned_value, &
      turned_taylor, series_at
  use lapwing_flank_table, only: te_table_t
  use lapwing_flow_exact_curve, only: scene_t, curve_t, motion_taylor, is_smooth
  use lapwing_flow_exact_panels, only: free_size, response_on
  use lapwing_system_oscillation, only: free_after, lasting, lasting_t, near_matrix, n_taylor
  use lapwing_polynomial_evaluation, only: max_degree, horner, horner_slope, jet
  implicit none
  private
  public :: curve_at, curve_taylor, rest_after, acceleration_at
  public :: fly_to_knot, flight_in, flight_at_edge, flight_series, flight_on_piece
  public :: free_in_middle, contact_series, range_of_flight, flight_bound

contains

  !> Position and velocity at s. `panel` holds t + s; at its end the values before any jump.
  pure subroutine curve_at(scene, curve, panel, s, x, v)
    type(scene_t), intent(in) :: scene
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
    type(scene_t), intent(in) :: scene
    integer, intent(in) :: panel               !! panel that holds t
    real(wp), intent(in) :: t                  !! time in the cycle
    real(wp), intent(out) :: g, slope          !! position and velocity
    real(wp) :: x
    integer :: piece
    g = 0
    slope = 0
    select type (flank => scene%flank)
    type is (series_flank_t)
      call series_at(flank%series, t, g, slope)
    type is (te_table_t)
      piece = scene%form%piece(panel)
      x = t - flank%knot(piece)
      g = horner(flank%coefficient(:, piece), x)
      slope = horner_slope(flank%coefficient(:, piece), x)
    end select
  end subroutine flank_at

  !> The same in contact: F + q + d.
  pure subroutine contact_at(scene, curve, panel, s, x, v)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve         !! arc
    integer, intent(in) :: panel               !! panel that holds t + s
    real(wp), intent(in) :: s                  !! time since its beginning
    real(wp), intent(out) :: x, v              !! position and velocity
    real(wp) :: q(2)
    associate (form => scene%form)
      if (curve%t + s >= form%edge(panel + 1)) then
        q = form%panel(panel)%q_end
      else
        q = response_on(form%panel(panel), curve%t + s)
      end if
      call add_free_part(scene, curve, s, q, x, v)
    end associate
  end subroutine contact_at

  !> Taylor coefficients of the motion about s, and a bound of |x^(6)|/6! from there on: within the
  !> panel, which holds t + s, or begins there.
  pure subroutine curve_taylor(scene, curve, panel, at_edge, s, c, rest)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve             !! arc
    integer, intent(in) :: panel
    logical, intent(in) :: at_edge                 !! whether it begins at s
    real(wp), intent(in) :: s                      !! time since the arc began
    real(wp), intent(out) :: c(0:max_degree)       !! coefficients
    real(wp), intent(out) :: rest                  !! bound
    real(wp) :: g(0:max_degree), q(2), x, v
    type(turned_t) :: turned
    select type (flank => scene%flank)
    type is (series_flank_t)
      ! The same sines serve g, its derivatives and q.
      if (at_edge) then
        g = scene%form%g_taylor(:, panel)
        q = scene%form%panel(panel)%q_begin
      else
        call turn_series(flank%series, curve%t + s, turned)
        call turned_taylor(flank%series, turned, g)
        if (curve%contact) call turned_value(scene%form%q, turned, q(1), q(2))
      end if
      if (s <= curve%near) then
        call curve_at(scene, curve, panel, s, x, v)
      else if (curve%contact) then
        call add_free_part(scene, curve, s, q, x, v)
      else
        call fly_from(scene, curve, s, g(0), g(1), x, v)
      end if
    class default
      call curve_at(scene, curve, panel, s, x, v)
      call flank%taylor(scene%form%piece(panel), curve%t + s, g)
    end select
    call motion_taylor(scene, curve%contact, x, v, g, c)
    rest = rest_after(scene, curve, panel, s)
  end subroutine curve_taylor

  !> Position and velocity in flight where the flank is known.
  pure subroutine fly_from(scene, curve, s, g, slope, x, v)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve             !! arc
    real(wp), intent(in) :: s                      !! time since it began
    real(wp), intent(in) :: g, slope               !! flank's position and velocity
    real(wp), intent(out) :: x, v                  !! position and velocity
    real(wp) :: rate
    rate = curve%v + curve%flank(2)
    x = curve%x + (rate + 0.5_wp*scene%force*s)*s - (g - curve%flank(1))
    v = rate + scene%force*s - slope
  end subroutine fly_from

  !> Position and velocity of a flight over a series at a time in a panel.
  pure function flight_in(scene, curve, panel, s) result(state)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve         !! arc
    integer, intent(in) :: panel
    real(wp), intent(in) :: s                  !! time since the arc began
    real(wp) :: state(2), g, slope, bend
    if (curve%t + s >= scene%form%edge(panel + 1)) then
      state = flight_at_edge(scene, curve, panel + 1, s)
    else
      associate (here => scene%form%panel(panel))
        call jet(n_taylor, here%g, curve%t + s - here%middle, g, slope, bend)
      end associate
      call fly_from(scene, curve, s, g, slope, state(1), state(2))
    end if
  end function flight_in

  !> The same where a panel begins, or the last one ends.
  pure function flight_at_edge(scene, curve, panel, s) result(state)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve         !! arc
    integer, intent(in) :: panel
    real(wp), intent(in) :: s                  !! time since the arc began
    real(wp) :: state(2)
    call fly_from(scene, curve, s, scene%form%g_taylor(0, panel), scene%form%g_taylor(1, panel), &
        state(1), state(2))
  end function flight_at_edge

  !> Position and velocity of a flight at the beginning of a piece.
  pure subroutine fly_to_knot(scene, curve, piece, x, v)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve         !! arc
    integer, intent(in) :: piece
    real(wp), intent(out) :: x, v              !! position and velocity
    real(wp) :: g(0:max_degree)
    call scene%flank%taylor(piece, scene%flank%knot(piece), g)
    call fly_from(scene, curve, scene%flank%knot(piece) - curve%t, g(0), g(1), x, v)
  end subroutine fly_to_knot

  !> Position and velocity in contact where the response is known.
  pure subroutine add_free_part(scene, curve, s, q, x, v)
    type(scene_t), intent(in) :: scene
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
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve             !! arc
    integer, intent(in) :: panel
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
      rest = rest + scene%form%panel(panel)%q_sixth
    else if (is_smooth(scene%flank)) then
      rest = scene%form%g_bound
    end if
  end function rest_after

  !> x'' where position and velocity are known.
  pure real(wp) function acceleration_at(scene, curve, panel, s, x, v) result(a)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve             !! arc
    integer, intent(in) :: panel                   !! panel that holds t + s
    real(wp), intent(in) :: s                      !! time since its beginning
    real(wp), intent(in) :: x, v                   !! position and velocity there
    real(wp) :: g(0:max_degree)
    call scene%flank%taylor(scene%form%piece(panel), curve%t + s, g)
    a = scene%force - 2*g(2)
    if (curve%contact) a = a - 2*scene%form%damping%xi*v - x
  end function acceleration_at

  !> d and d' in the middle of the panel in which an arc begins, which may lie before that.
  pure function free_in_middle(scene, curve, panel) result(free)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve             !! arc
    integer, intent(in) :: panel
    real(wp) :: free(2), matrix(2, 2)
    matrix = near_matrix(scene%form%damping, scene%form%panel(panel)%middle - curve%t)
    free = matrix(:, 1)*curve%free(1) + matrix(:, 2)*curve%free(2)
  end function free_in_middle

  !> Taylor series of x about a panel's middle in contact, exact to rounding over the panel.
  pure subroutine contact_series(scene, panel, free, c)
    type(scene_t), intent(in) :: scene
    integer, intent(in) :: panel
    real(wp), intent(in) :: free(2)                !! d and d' in its middle
    real(wp), intent(out) :: c(0:n_taylor)         !! coefficients
    associate (unit => scene%form%damping%unit)
      c = (unit(:, 1)*free(1) + unit(:, 2)*free(2)) + scene%form%panel(panel)%q
    end associate
    c(0) = c(0) + scene%force
  end subroutine contact_series

  !> The same, of sign*(x - wall), in a flight over a series.
  pure subroutine flight_series(scene, curve, panel, sign, wall, c)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve             !! arc
    integer, intent(in) :: panel
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
    type(scene_t), intent(in) :: scene
    integer, intent(in) :: piece
    real(wp), intent(in) :: x, v                   !! position and velocity, after any jump
    real(wp) :: c(0:max_degree)
    c = 0
    select type (flank => scene%flank)
    type is (te_table_t)
      c = -flank%coefficient(:, piece)
    end select
    c(0) = x
    c(1) = v
    c(2) = c(2) + 0.5_wp*scene%force
  end function flight_on_piece

  !> Least and greatest theta of a flight between two times: a parabola lies on one side of its
  !> chord, no farther from it than acceleration*duration**2/8.
  pure subroutine range_of_flight(scene, curve, begin, finish, low, high)
    type(scene_t), intent(in) :: scene
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

  !> Upper bound of sign*x in a flight between two times, from the range of g there.
  pure real(wp) function flight_bound(scene, curve, sign, begin, finish, g_low, g_high) &
      result(bound)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve         !! arc
    real(wp), intent(in) :: sign               !! +1 or -1
    real(wp), intent(in) :: begin, finish      !! times since the arc began
    real(wp), intent(in) :: g_low, g_high      !! range of g between them
    real(wp) :: low, high
    call range_of_flight(scene, curve, begin, finish, low, high)
    bound = merge(high - g_low, g_high - low, sign > 0)
  end function flight_bound
end module lapwing_flow_exact_motion
