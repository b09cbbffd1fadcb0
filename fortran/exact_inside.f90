!> What observers ask of a stretch in closed form: where it turns, and how far it goes.
module lapwing_exact_inside
  use lapwing_kinds, only: wp
  use lapwing_closed_form, only: locate_panel
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
  !> Panels are bounded by their Bernstein coefficients; only those that could hold a larger value
  !> than the ends of all panels are searched.
  pure real(wp) function farthest(scene, curve, sign, until, least) result(most)
    type(scene_t), intent(in) :: scene         !! scene
    type(curve_t), intent(in) :: curve         !! stretch, its series known
    real(wp), intent(in) :: sign               !! +1: the largest x, -1: the smallest
    real(wp), intent(in) :: until              !! end of the stretch
    real(wp), intent(in) :: least              !! value known already
    real(wp) :: begin, finish, x, v, c(0:max_degree), rest
    integer :: panel, first, pass
    first = locate_panel(scene%form, curve%t)
    most = max(least, sign*curve%x)
    do pass = 1, 2
      panel = first
      begin = 0
      do
        finish = min(scene%form%edge(panel + 1) - curve%t, until)
        if (pass == 1) then
          call curve_at(scene, curve, panel, finish, x, v)
          most = max(most, sign*x)
        else
          call curve_taylor(scene, curve, panel, begin > 0, begin, c, rest)
          if (maxval(bernstein_on(sign*c, finish - begin)) &
              + rest*(finish - begin)**(max_degree + 1) > most) then
            call search(begin, finish)
          end if
        end if
        if (finish >= until .or. panel == scene%form%n) exit
        begin = finish
        panel = panel + 1
      end do
    end do
  contains
    pure subroutine search(lower, upper)
      real(wp), intent(in) :: lower, upper   !! part of a panel
      real(wp) :: from, s, at, rate
      logical :: found
      from = lower
      do
        call first_turn(scene, curve, panel, from > lower, from, upper, found, s)
        if (.not. found .or. s <= from) return
        call curve_at(scene, curve, panel, s, at, rate)
        most = max(most, sign*at)
        from = s
      end do
    end subroutine search
  end function farthest
end module lapwing_exact_inside
