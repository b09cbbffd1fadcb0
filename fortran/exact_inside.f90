!> What observers ask of a stretch in closed form: where it turns, and how far it goes.
module lapwing_exact_inside
  use lapwing_kinds, only: wp
  use lapwing_closed_form, only: locate_panel, free_size
  use lapwing_first_meeting, only: first_turn
  use lapwing_polynomial, only: max_degree, bernstein_on
  use lapwing_smooth_curve, only: scene_t, curve_t, curve_at, curve_taylor
  implicit none
  private
  public :: next_turn, farthest

contains

  !> First time after `from`, which is zero or such a time itself, where the velocity relative to
  !> the flank changes sign.
  pure subroutine next_turn(scene, curve, from, until, found, s)
    type(scene_t), intent(in) :: scene         !! scene
    type(curve_t), intent(in) :: curve         !! stretch, its series known
    real(wp), intent(in) :: from, until        !! times since its beginning
    logical, intent(out) :: found              !! whether there is one
    real(wp), intent(out) :: s                 !! when
    real(wp) :: begin, finish
    integer :: panel
    panel = locate_panel(scene%form, curve%t + from)
    begin = from
    do
      finish = min(scene%form%edge(panel + 1) - curve%t, until)
      call first_turn(scene, curve, panel, begin > 0 .and. begin == from, begin, finish, found, s)
      found = found .and. s > from .and. s < until
      if (found .or. finish >= until .or. panel == scene%form%n) return
      begin = finish
      panel = panel + 1
    end do
  end subroutine next_turn

  !> Largest sign*x over a stretch, if it exceeds `least`; else `least`.
  !>
  !> Panels are bounded by their Bernstein coefficients, blocks of panels by ranges; only those that
  !> could hold a larger value than the ends of all of them are searched.
  pure real(wp) function farthest(scene, curve, sign, until, least) result(most)
    type(scene_t), intent(in) :: scene         !! scene
    type(curve_t), intent(in) :: curve         !! stretch, its series known
    real(wp), intent(in) :: sign               !! +1: the largest x, -1: the smallest
    real(wp), intent(in) :: until              !! end of the stretch
    real(wp), intent(in) :: least              !! value known already
    real(wp) :: begin, finish, x, v
    integer :: panel, first, last, pass
    first = locate_panel(scene%form, curve%t)
    most = max(least, sign*curve%x)
    do pass = 1, 2
      panel = first
      begin = 0
      do
        last = last_of_block(scene, panel)
        finish = min(scene%form%edge(last + 1) - curve%t, until)
        if (pass == 1) then
          if (finish >= until) last = min(last, locate_panel(scene%form, curve%t + until))
          call curve_at(scene, curve, last, finish, x, v)
          most = max(most, sign*x)
        else if (last > panel) then
          if (block_bound(scene, curve, sign, panel, begin, finish) > most) then
            last = panel
            finish = min(scene%form%edge(last + 1) - curve%t, until)
          end if
        end if
        if (pass == 2 .and. last == panel) call search_panel(begin, finish)
        if (finish >= until .or. last == scene%form%n) exit
        begin = finish
        panel = last + 1
      end do
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
  end function farthest

  !> Last panel of the block that a panel begins, or the panel itself.
  pure integer function last_of_block(scene, panel) result(last)
    type(scene_t), intent(in) :: scene         !! scene
    integer, intent(in) :: panel               !! panel
    last = panel
    if (scene%blocks%panels == 0) return
    if (mod(panel - 1, scene%blocks%panels) /= 0) return
    last = min(panel + scene%blocks%panels - 1, scene%form%n)
  end function last_of_block

  !> Upper bound of sign*x over a block, in flight from ranges of g and of the parabola, in contact
  !> from the range of the response and the size of the free oscillation, which never grows.
  pure real(wp) function block_bound(scene, curve, sign, panel, begin, finish) result(bound)
    type(scene_t), intent(in) :: scene         !! scene
    type(curve_t), intent(in) :: curve         !! stretch
    real(wp), intent(in) :: sign               !! +1 or -1
    integer, intent(in) :: panel               !! first panel of the block
    real(wp), intent(in) :: begin, finish      !! times since the stretch began
    real(wp) :: theta(2), rate, sag
    associate (block => scene%blocks%over((panel - 1)/scene%blocks%panels + 1))
      if (curve%contact) then
        bound = sign*scene%force + free_size(curve%free)
        if (curve%moving) bound = bound + merge(block%q_high, -block%q_low, sign > 0)
      else
        rate = curve%v + curve%flank(2)
        theta = (curve%x + curve%flank(1)) + (rate + 0.5_wp*scene%force*[begin, finish]) &
            *[begin, finish]
        ! A parabola is this far from its chord, at most.
        sag = 0.125_wp*abs(scene%force)*(finish - begin)**2
        bound = max(sign*theta(1), sign*theta(2)) + sag
        if (curve%moving) bound = bound + merge(-block%g_low, block%g_high, sign > 0)
      end if
    end associate
  end function block_bound
end module lapwing_exact_inside
