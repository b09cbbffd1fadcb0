!> What observers ask of an arc in closed form: where it turns, and how far it goes.
module lapwing_flow_exact_extrema
  use lapwing_kinds, only: wp
  use lapwing_flow, only: start_order
  use lapwing_flow_exact_curve, only: scene_t, curve_t, is_smooth
  use lapwing_flow_exact_motion, only: curve_at, curve_taylor, acceleration_at, flight_in, &
      flight_at_edge, flight_series, flight_bound
  use lapwing_flow_exact_piecewise_flights, only: farthest_over_pieces
  use lapwing_flow_exact_interval_bounds, only: widest_level, block_at, last_in_block
  use lapwing_flow_exact_panels, only: locate_panel, free_size
  use lapwing_flow_exact_root_search, only: first_turn
  use lapwing_system_oscillation, only: n_taylor, free_after
  use lapwing_flow_exact_slow_contact, only: slow_turn, slow_farthest, panel_in_contact
  use lapwing_polynomial_evaluation, only: max_degree, bernstein_on
  use lapwing_polynomial_roots, only: raise_to_turn
  implicit none
  private
  public :: next_near_turn, next_turn, farthest

  !> A velocity in contact that is less than this part of the depth, per unit of tau, is rounding.
  real(wp), parameter :: still = 1000*epsilon(1.0_wp)
  !> Turns are not looked for in so small a part of an arc once they are rounding.
  integer, parameter :: most_leaps = 1000

contains

  !> First time after `from`, which is zero or that of a turn, at which sign*x turns upwards,
  !> positive and not beyond `within`.
  pure subroutine next_near_turn(scene, curve, sign, within, from, until, found, s)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve         !! arc, its series known
    real(wp), intent(in) :: sign               !! +1 or -1
    real(wp), intent(in) :: within             !! largest sign*x that is asked for
    real(wp), intent(in) :: from, until        !! times since its beginning
    logical, intent(out) :: found              !! whether there is one
    real(wp), intent(out) :: s                 !! when
    real(wp) :: begin, x, v
    integer :: panel
    begin = from
    do
      call next_turn(scene, curve, sign, within, begin, until, found, s)
      if (.not. found) return
      panel = panel_in_contact(scene, curve, s)
      call curve_at(scene, curve, panel, s, x, v)
      if (sign*x > 0 .and. sign*x <= within) then
        if (sign*acceleration_at(scene, curve, panel, s, x, v) > 0) return
      end if
      begin = s
    end do
  end subroutine next_near_turn

  !> First time after `from`, which is zero or such a time itself, where the velocity relative to
  !> the flank changes sign; of turns with sign*x > within some may be left out. Where a tooth
  !> stands still on its flank rounding does so without end: that is leapt over, ever farther.
  pure subroutine next_turn(scene, curve, sign, within, from, until, found, s)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve         !! arc, its series known
    real(wp), intent(in) :: sign               !! +1 or -1
    real(wp), intent(in) :: within             !! largest sign*x that is asked for
    real(wp), intent(in) :: from, until        !! times since its beginning
    logical, intent(out) :: found              !! whether there is one
    real(wp), intent(out) :: s                 !! when
    real(wp) :: begin, leap
    begin = from
    leap = 0
    do
      call turn_from(scene, curve, sign, within, from > 0 .and. begin == from, begin, until, &
          found, s)
      if (.not. found) return
      if (.not. is_still(scene, curve, 0.5_wp*(begin + s))) return
      leap = min(max(2*leap, s - begin), until/most_leaps)
      begin = s + leap
      found = begin < until
      if (.not. found) return
    end do
  end subroutine next_turn

  !> Whether the velocity in a contact, whose time has the spring's unit, is rounding at a time.
  pure logical function is_still(scene, curve, s)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve         !! arc
    real(wp), intent(in) :: s                  !! time since it began
    real(wp) :: x, v
    is_still = .false.
    if (.not. curve%contact) return
    call curve_at(scene, curve, panel_in_contact(scene, curve, s), s, x, v)
    is_still = abs(v) <= still*abs(x)
  end function is_still

  !> First time after `from` where the sign changes, rounding or not.
  pure subroutine turn_from(scene, curve, sign, within, at_turn, from, until, found, s)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve         !! arc, its series known
    real(wp), intent(in) :: sign               !! +1 or -1
    real(wp), intent(in) :: within             !! largest sign*x that is asked for
    logical, intent(in) :: at_turn             !! whether `from` is such a time
    real(wp), intent(in) :: from, until        !! times since its beginning
    logical, intent(out) :: found              !! whether there is one
    real(wp), intent(out) :: s                 !! when
    real(wp) :: begin, finish
    integer :: panel
    if (curve%contact .and. scene%form%graded) then
      call slow_turn(scene, curve, at_turn, from, until, found, s)
      return
    end if
    panel = locate_panel(scene%form, curve%t + from)
    begin = from
    do
      finish = min(scene%form%edge(panel + 1) - curve%t, until)
      call first_turn(scene, curve, panel, at_turn .and. begin == from, begin, finish, found, s)
      found = found .and. s > from .and. s < until
      if (found .or. finish >= until .or. panel == scene%form%n) return
      panel = panel + 1
      if (scene%blocks%panels%levels > 1) call pass_far(scene, curve, sign, within, until, panel)
      if (panel > scene%form%n) return
      begin = scene%form%edge(panel) - curve%t
      if (begin >= until) return
    end do
  end subroutine turn_from

  !> From a panel past all blocks on which sign*x stays above `within`.
  pure subroutine pass_far(scene, curve, sign, within, until, panel)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve         !! arc, its series known
    real(wp), intent(in) :: sign               !! +1 or -1
    real(wp), intent(in) :: within             !! largest sign*x that is asked for
    real(wp), intent(in) :: until              !! end of the arc
    integer, intent(inout) :: panel            !! panel, then the one to be looked at next, or n + 1
    real(wp) :: begin, finish
    integer :: level, last
    do while (panel <= scene%form%n)
      begin = scene%form%edge(panel) - curve%t
      if (begin >= until) return
      do level = widest_level(scene%blocks%panels, panel), 1, -1
        last = last_in_block(scene%blocks%panels, level, panel)
        finish = min(scene%form%edge(last + 1) - curve%t, until)
        if (block_bound(scene, curve, -sign, level, panel, begin, finish) < -within) exit
      end do
      if (level == 0) return
      panel = last + 1
    end do
  end subroutine pass_far

  !> Largest sign*x over an arc, if it exceeds `least`; else `least`.
  pure real(wp) function farthest(scene, curve, sign, until, least)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve         !! arc, its series known
    real(wp), intent(in) :: sign               !! +1: the largest x, -1: the smallest
    real(wp), intent(in) :: until              !! end of the arc
    real(wp), intent(in) :: least              !! value known already
    real(wp) :: c(0:start_order)
    logical :: found
    if (.not. curve%contact) then
      if (.not. is_smooth(scene%flank)) then
        farthest = farthest_over_pieces(scene, curve, sign, until, least)
        return
      end if
      if (until <= curve%near) then
        farthest = max(least, sign*curve%x)
        c = sign*curve%taylor
        call raise_to_turn(c(:curve%degree), 0.0_wp, until, farthest, found)
        if (found) return
      end if
      farthest = farthest_over_series(scene, curve, sign, until, least)
      return
    end if
    if (scene%form%graded) then
      farthest = slow_farthest(scene, curve, sign, until, least)
    else
      farthest = farthest_over_panels(scene, curve, sign, until, least)
    end if
  end function farthest

  !> In flight over a series: from panel to panel, where a bound of what g bends tells how the
  !> motion turns between two known states.
  pure real(wp) function farthest_over_series(scene, curve, sign, until, least) result(most)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve         !! arc, the flank's motion at its beginning known
    real(wp), intent(in) :: sign               !! +1: the largest x, -1: the smallest
    real(wp), intent(in) :: until              !! end of the arc
    real(wp), intent(in) :: least              !! value known already
    real(wp) :: begin, finish, after, from(2), to(2)
    integer :: panel, last
    most = max(least, sign*curve%x)
    begin = 0
    finish = until
    call narrow(scene, curve, sign, until, most, begin, finish)
    if (begin >= finish) return
    panel = locate_panel(scene%form, curve%t + begin)
    begin = max(scene%form%edge(panel) - curve%t, 0.0_wp)
    from = sign*[curve%x, curve%v]
    if (begin > 0) from = sign*flight_at_edge(scene, curve, panel, begin)
    if (scene%blocks%panels%levels > 0) call look_at_ends(scene, curve, sign, finish, &
        scene%blocks%panels%levels, panel, most)
    do
      call pass_block(scene, curve, sign, panel, begin, until, most, last, after)
      to = sign*flight_in(scene, curve, last, after)
      most = max(most, to(1))
      if (last == panel) call raise_in_panel(scene, curve, sign, panel, begin, after, from, to, &
          most)
      if (after >= finish .or. last == scene%form%n) return
      begin = after
      from = to
      panel = last + 1
    end do
  end function farthest_over_series

  !> The part of a flight that may exceed what is known, raised at the turn of theta first: where
  !> theta turns down or up, as is asked for, it may within an interval about that only.
  pure subroutine narrow(scene, curve, sign, until, most, begin, finish)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve         !! arc, the flank's motion at its beginning known
    real(wp), intent(in) :: sign               !! +1 or -1
    real(wp), intent(in) :: until              !! end of the arc
    real(wp), intent(inout) :: most            !! largest value
    real(wp), intent(inout) :: begin, finish   !! the arc; then that part, empty if begin >= finish
    real(wp) :: a, rate, turn, room, x(2)
    a = -sign*scene%force
    if (.not. a > 0) return
    rate = sign*(curve%v + curve%flank(2))
    turn = min(max(rate/a, 0.0_wp), until)
    x = sign*flight_in(scene, curve, locate_panel(scene%form, curve%t + turn), turn)
    most = max(most, x(1))
    ! What sign*theta exceeds at its turn, beyond all that the flank may add.
    room = (sign*(curve%x + curve%flank(1)) + 0.5_wp*rate**2/a) &
        + (merge(-scene%form%g_low, scene%form%g_high, sign > 0) - most)
    begin = finish
    if (room <= 0) return
    begin = max((rate - sqrt(2*a*room))/a, 0.0_wp)
    finish = min((rate + sqrt(2*a*room))/a, until)
  end subroutine narrow

  !> Raise `most` to the largest sign*x in part of a panel, in flight over a series.
  pure subroutine raise_in_panel(scene, curve, sign, panel, begin, finish, from, to, most)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve         !! arc
    real(wp), intent(in) :: sign               !! +1 or -1
    integer, intent(in) :: panel
    real(wp), intent(in) :: begin, finish      !! the part
    real(wp), intent(in) :: from(2), to(2)     !! sign*[x, v] there
    real(wp), intent(inout) :: most            !! largest value, not below those there
    real(wp) :: bend, high, width, series(0:n_taylor), s, middle, at(2)
    logical :: found
    width = finish - begin
    associate (here => scene%form%panel(panel))
      bend = sign*(scene%force - 2*here%g(2))
      if (bend - here%g_bend >= 0) return
      high = bend + here%g_bend
      if (from(2) <= 0 .or. to(2) >= 0) then
        ! It would have to bend up to turn twice.
        if (max(to(2), -from(2)) >= 0.5_wp*high*width) return
      else
        ! It is below both tangents wherever it bends down.
        s = (to(1) - from(1) - to(2)*width)/(from(2) - to(2))
        if (high <= 0 .and. from(1) + from(2)*s <= most) return
      end if
      if (flight_bound(scene, curve, sign, begin, finish, here%g_low, here%g_high) <= most) return
      middle = here%middle - curve%t
    end associate
    call flight_series(scene, curve, panel, sign, 0.0_wp, series)
    call raise_to_turn(series, begin - middle, finish - middle, most, found)
    if (found) return
    s = begin
    do
      call first_turn(scene, curve, panel, s > begin, s, finish, found, middle)
      if (.not. found .or. middle <= s) return
      s = middle
      at = sign*flight_in(scene, curve, panel, s)
      most = max(most, at(1))
    end do
  end subroutine raise_in_panel

  !> In contact.
  !>
  !> Panels are bounded by their Bernstein coefficients, blocks of panels by ranges; only those that
  !> could hold a larger value than the ends of all of them are searched.
  pure real(wp) function farthest_over_panels(scene, curve, sign, until, least) result(most)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve         !! arc, its series known
    real(wp), intent(in) :: sign               !! +1: the largest x, -1: the smallest
    real(wp), intent(in) :: until              !! end of the arc
    real(wp), intent(in) :: least              !! value known already
    real(wp) :: begin, finish
    integer :: panel, last
    most = max(least, sign*curve%x)
    panel = locate_panel(scene%form, curve%t)
    call look_at_ends(scene, curve, sign, until, scene%blocks%panels%levels, panel, most)
    begin = 0
    do
      call pass_block(scene, curve, sign, panel, begin, until, most, last, finish)
      if (last == panel) call search_panel(begin, finish)
      if (finish >= until .or. last == scene%form%n) return
      begin = finish
      panel = last + 1
    end do
  contains
    !> Part of a panel: where it could hold a larger value, its turns.
    pure subroutine search_panel(lower, upper)
      real(wp), intent(in) :: lower, upper   !! part of the panel
      real(wp) :: from, s, at, rate, c(0:max_degree), rest
      logical :: found
      call curve_taylor(scene, curve, panel, lower > 0, lower, c, rest)
      if (maxval(bernstein_on(sign*c, upper - lower)) + rest*(upper - lower)**(max_degree + 1) &
          <= most) return
      from = lower
      do
        call first_turn(scene, curve, panel, from > lower, from, upper, found, s)
        if (.not. found .or. s <= from) return
        call curve_at(scene, curve, panel, s, at, rate)
        most = max(most, sign*at)
        from = s
      end do
    end subroutine search_panel
  end function farthest_over_panels

  !> The widest block that a panel begins over which sign*x stays below `most`; else the panel.
  !> Where one does not, the ends of the blocks in it raise `most` first.
  pure subroutine pass_block(scene, curve, sign, panel, begin, until, most, last, finish)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve         !! arc, its series known
    real(wp), intent(in) :: sign               !! +1 or -1
    integer, intent(in) :: panel
    real(wp), intent(in) :: begin, until       !! when it begins, when the arc ends
    real(wp), intent(inout) :: most            !! largest value
    integer, intent(out) :: last               !! last panel of the block
    real(wp), intent(out) :: finish            !! when it ends, or the arc
    integer :: level
    do level = widest_level(scene%blocks%panels, panel), 0, -1
      last = last_in_block(scene%blocks%panels, level, panel)
      finish = min(scene%form%edge(last + 1) - curve%t, until)
      if (level == 0) return
      if (block_bound(scene, curve, sign, level, panel, begin, finish) <= most) return
      if (level > 1) call look_at_ends(scene, curve, sign, finish, level - 1, panel, most)
    end do
  end subroutine pass_block

  !> Raise `most` to the largest sign*x at the ends of blocks, or of panels where there are none.
  pure subroutine look_at_ends(scene, curve, sign, until, widest, first, most)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve         !! arc, its series known
    real(wp), intent(in) :: sign               !! +1 or -1
    real(wp), intent(in) :: until              !! end of the arc, or of what is looked at
    integer, intent(in) :: widest              !! level of blocks, at most
    integer, intent(in) :: first               !! panel
    real(wp), intent(inout) :: most            !! largest value
    real(wp) :: finish
    integer :: last
    last = first
    do
      last = last_in_block(scene%blocks%panels, min(widest, widest_level(scene%blocks%panels, &
          last)), last)
      finish = scene%form%edge(last + 1) - curve%t
      if (finish >= until) exit
      most = max(most, height(last, finish))
      if (last == scene%form%n) return
      last = last + 1
    end do
    most = max(most, height(min(last, locate_panel(scene%form, curve%t + until)), until))
  contains
    !> sign*x at a time on a panel, or at its end.
    pure real(wp) function height(panel, s)
      integer, intent(in) :: panel
      real(wp), intent(in) :: s                !! time since the arc began
      real(wp) :: state(2)
      if (curve%contact) then
        call curve_at(scene, curve, panel, s, state(1), state(2))
      else
        state = flight_in(scene, curve, panel, s)
      end if
      height = sign*state(1)
    end function height
  end subroutine look_at_ends

  !> Upper bound of sign*x over a block, in flight from ranges of g and of the parabola, in contact
  !> from the range of the response and the size of the free oscillation, which never grows and in a
  !> short block changes little.
  pure real(wp) function block_bound(scene, curve, sign, level, panel, begin, finish) result(bound)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve         !! arc
    real(wp), intent(in) :: sign               !! +1 or -1
    integer, intent(in) :: level               !! of the block
    integer, intent(in) :: panel               !! its first panel
    real(wp), intent(in) :: begin, finish      !! times since the arc began
    real(wp) :: size, free(2)
    associate (block => scene%blocks%over(block_at(scene%blocks%panels, level, panel)))
      if (curve%contact) then
        size = free_size(curve%free)
        bound = sign*scene%force + merge(block%q_high, -block%q_low, sign > 0)
        if (scene%blocks%panels%levels > 1 .and. finish - begin < 1) then
          free = free_after(scene%form%damping, curve%free, begin, scene%form%graded)
          bound = bound + min(size, sign*free(1) + size*(finish - begin))
        else
          bound = bound + size
        end if
      else
        bound = flight_bound(scene, curve, sign, begin, finish, block%g_low, block%g_high)
      end if
    end associate
  end function block_bound
end module lapwing_flow_exact_extrema
