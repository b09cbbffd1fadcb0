!> Where an arc first crosses a position, or first turns, with a guarantee.
!>
!> Around any time the motion is a polynomial of degree five and a remainder that is bounded. Less
!> that bound, the polynomial's Bernstein coefficients show up to where there can be no zero: the
!> search begins anew there, over a shorter time. Once the remainder is below rounding the
!> polynomial decides. A zero is taken before that only where slope, curvature and remainder say
!> that it exists and is the only one near.
module lapwing_flow_exact_root_search
  use lapwing_kinds, only: wp
  use lapwing_flow_exact_curve, only: scene_t, curve_t
  use lapwing_flow_exact_motion, only: curve_at, curve_taylor, rest_after, acceleration_at
  use lapwing_flow_exact_panels, only: bound_order
  use lapwing_polynomial_evaluation, only: max_degree, horner, horner_slope, jet
  use lapwing_polynomial_roots, only: first_zero, first_nonzero, lift_off, newton
  use lapwing_system_oscillation, only: n_taylor
  implicit none
  private
  public :: target_t, first_crossing, first_turn, turn_after, quick_return, only_zero

  !> What is looked for within one panel.
  type :: target_t
    real(wp) :: sign = 1          !! sign*(x - wall) is positive before
    real(wp) :: wall = 0          !! position met
    logical :: touching = .false. !! it is zero where the search begins, and leaves
    logical :: turn = .false.     !! not the position, but sign*v
  end type target_t

  !> Each shrinks the time by this factor, the remainder by its sixth power: five of them take any
  !> remainder below rounding.
  real(wp), parameter :: shrink = 0.125_wp
  !> Searches of an arc; never used up, for each either shrinks the time or moves on by it.
  integer, parameter :: max_searches = 10000
  integer, parameter :: max_newton = 12
  !> Error of a zero that is only a guess, over the time searched; it is found early rather than
  !> late. Two Newton steps make sixteen digits of its four. With 1e-3 and 1e-5 random scenes have
  !> the same events.
  real(wp), parameter :: rough = 1.0e-4_wp
  !> A return to a position just left is polished only if it is that many such errors away: what is
  !> polished has a zero at the beginning, too, and turns half-way.
  real(wp), parameter :: well_apart = 32

contains

  !> First zero of a target between two times of a panel.
  pure subroutine first_crossing(scene, curve, panel, from_edge, goal, from, to, found, s, &
      x, v)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve         !! arc
    integer, intent(in) :: panel               !! panel that holds the times
    logical, intent(in) :: from_edge           !! whether it begins at the first of them
    type(target_t), intent(in) :: goal         !! what is looked for
    real(wp), intent(in) :: from, to           !! times since the arc began
    logical, intent(out) :: found              !! whether there is one
    real(wp), intent(out) :: s                 !! when
    real(wp), intent(out) :: x, v              !! position and velocity then
    real(wp) :: f(0:max_degree), low(0:max_degree), at, width, rest, y
    integer :: i, times
    logical :: exact, hit
    found = .false.
    s = to
    x = 0
    v = 0
    at = from
    width = to - from
    do i = 1, max_searches
      width = min(width, to - at)
      call expand_goal(scene, curve, panel, from_edge .and. at <= from, goal, at, f, rest)
      call leave_zero(goal%touching .and. at <= from, f, times, hit)
      if (hit) then
        found = .true.
        s = at
        call curve_at(scene, curve, panel, s, x, v)
        return
      end if
      rest = rest*width**(merge(bound_order - 1, bound_order, goal%turn) - times)
      exact = rest <= 4*epsilon(width)*size_of(f, width)
      low = f
      if (.not. exact) low(0) = f(0) - rest
      if (low(0) <= 0 .and. .not. exact) then
        width = shrink*width
        cycle
      end if
      ! Not exact, it is the first guess of what is polished.
      call first_zero(low, width, hit, y, merge(0.0_wp, rough, exact))
      if (.not. hit) then
        at = at + width
        if (at >= to) return
        width = width/shrink
      else
        found = exact
        if (.not. exact .and. (times == 0 .or. y > well_apart*rough*width)) then
          found = is_isolated(f, y, rest, times, width)
        end if
        if (found) then
          ! Exact, it is the polynomial's own zero, and stays that where polishing is no use.
          call polish(scene, curve, panel, goal, at, at + y, to, found, s, x, v)
          found = found .or. exact
          if (found) return
        end if
        ! Up to the guess, less its error, there is no zero; the sign there makes sure.
        y = y - 2*rough*width
        if (y > 0) then
          if (horner(low, y) > 0) at = at + y
        end if
        width = shrink*width
      end if
    end do
  end subroutine first_crossing

  !> The one zero of a target on a panel, from its Taylor series about the middle, where it is plain
  !> that there is just one: a target that is positive at the beginning, negative at the end, and
  !> falls throughout or bends down throughout. Elsewhere nothing is claimed.
  !>
  !> On a panel of unit width the slope of the polynomial of degree five is 5 times the differences
  !> of its Bernstein coefficients; of what it leaves out, at most rest*(2u)**6 with u from -1/2 to
  !> 1/2, it is at most 12*rest. The second derivatives: 20 times their differences, and 120*rest.
  pure subroutine only_zero(c, half, b, rest, found, u, slope)
    real(wp), intent(in) :: c(0:n_taylor)      !! coefficients, exact to rounding
    real(wp), intent(in) :: half               !! half the panel's width
    real(wp), intent(in) :: b(0:max_degree)    !! Bernstein coefficients of the first six
    real(wp), intent(in) :: rest               !! bound of what these leave out
    logical, intent(out) :: found              !! whether there is just one, and it is found
    real(wp), intent(out) :: u                 !! where, from the middle
    real(wp), intent(out) :: slope             !! and the slope there
    real(wp) :: fall(max_degree), value, bend, step
    integer :: i
    found = .false.
    u = 0
    slope = 0
    if (.not. (b(0) > rest .and. b(max_degree) < -rest)) return
    fall = b(0:max_degree - 1) - b(1:max_degree)
    if (.not. all(fall > 2.4_wp*rest)) then
      if (.not. all(fall(2:) - fall(:max_degree - 1) > 6*rest)) return
    end if
    do i = 1, max_degree - 1
      if (b(i) <= 0) exit
    end do
    ! From where the polygon of the coefficients crosses.
    u = half*(0.4_wp*(i - b(i)/(b(i) - b(i - 1))) - 1)
    do i = 1, max_newton
      if (.not. abs(u) <= half) return
      ! The first time ten terms do: no error of theirs is left after the next.
      call jet(merge(9, n_taylor, i == 1), c, u, value, slope, bend)
      if (slope >= 0) return
      step = halley(value, slope, bend)
      u = u + step
      slope = slope + 2*bend*step
      ! The error left is of the third order in the step, that of the slope of the second.
      found = i > 1 .and. abs(step) <= 0.5_wp*sqrt(epsilon(u))*half
      if (found) exit
    end do
    found = found .and. abs(u) <= half
  end subroutine only_zero

  !> Halley's step to a zero (third order).
  pure real(wp) function halley(value, slope, bend)
    real(wp), intent(in) :: value, slope   !! of the function
    real(wp), intent(in) :: bend           !! half its second derivative
    real(wp) :: square
    square = slope*slope - value*bend
    halley = 0
    if (square > 0) halley = -value*slope/square
  end function halley

  !> First time after `from` where the velocity relative to the flank changes sign.
  pure subroutine first_turn(scene, curve, panel, at_turn, from, to, found, s)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve         !! arc
    integer, intent(in) :: panel               !! panel that holds the times
    logical, intent(in) :: at_turn             !! whether `from` is such a time
    real(wp), intent(in) :: from, to           !! times since the arc began
    logical, intent(out) :: found              !! whether there is one
    real(wp), intent(out) :: s                 !! when
    type(target_t) :: goal
    real(wp) :: x, v
    goal = turn_after(scene, curve, panel, at_turn, from)
    call first_crossing(scene, curve, panel, .false., goal, from, to, found, s, x, v)
  end subroutine first_turn

  !> The target of that search.
  pure function turn_after(scene, curve, panel, at_turn, from) result(goal)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve         !! arc
    integer, intent(in) :: panel               !! panel that holds the time
    logical, intent(in) :: at_turn             !! whether `from` is a turn
    real(wp), intent(in) :: from               !! time since the arc began
    type(target_t) :: goal
    real(wp) :: x, v
    call curve_at(scene, curve, panel, from, x, v)
    goal%touching = at_turn .or. v == 0
    if (goal%touching) v = acceleration_at(scene, curve, panel, from, x, v)
    goal%sign = sign(1.0_wp, v)
    goal%turn = .true.
  end function turn_after

  !> Taylor coefficients of the target, and the bound of what they leave out per power of time.
  pure subroutine expand_goal(scene, curve, panel, at_edge, goal, at, f, rest)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve             !! arc
    integer, intent(in) :: panel
    logical, intent(in) :: at_edge                 !! whether it begins at `at`
    type(target_t), intent(in) :: goal             !! what is looked for
    real(wp), intent(in) :: at                     !! time since the arc began
    real(wp), intent(out) :: f(0:max_degree)       !! coefficients
    real(wp), intent(out) :: rest                  !! bound
    real(wp) :: c(0:max_degree)
    if (at <= 0 .and. curve%near >= 0) then
      c = curve%taylor(0:max_degree)
      rest = rest_after(scene, curve, panel, 0.0_wp)
    else
      call curve_taylor(scene, curve, panel, at_edge, at, c, rest)
    end if
    call goal_of(goal, c, f, rest)
  end subroutine expand_goal

  !> The target's coefficients and bound from the motion's.
  pure subroutine goal_of(goal, c, f, rest)
    type(target_t), intent(in) :: goal             !! what is looked for
    real(wp), intent(in) :: c(0:max_degree)        !! coefficients of the motion
    real(wp), intent(out) :: f(0:max_degree)       !! and of the target
    real(wp), intent(inout) :: rest                !! bound of what they leave out
    integer :: k
    if (goal%turn) then
      f = [(goal%sign*k*c(k), k = 1, max_degree), 0.0_wp]
      rest = bound_order*rest
    else
      f = goal%sign*c
      f(0) = goal%sign*(c(0) - goal%wall)
    end if
  end subroutine goal_of

  !> A target that is zero, or below by rounding, where the search begins: divide its zero out, or
  !> say that it is met at once because it falls.
  pure subroutine leave_zero(leaves, f, times, met)
    logical, intent(in) :: leaves                    !! whether it is known to rise from zero
    real(wp), intent(inout) :: f(0:max_degree)       !! coefficients
    integer, intent(out) :: times                    !! divisions
    logical, intent(out) :: met                      !! whether it is met here
    times = 0
    met = .false.
    if (leaves) f(0) = 0
    if (f(0) > 0) return
    met = .not. leaves .and. first_nonzero(f(1:)) < 0
    if (.not. met) call lift_off(f, times)
    if (times > max_degree) f(0) = 1
  end subroutine leave_zero

  pure real(wp) function size_of(f, width)
    real(wp), intent(in) :: f(0:max_degree)   !! coefficients
    real(wp), intent(in) :: width             !! interval
    integer :: k
    size_of = abs(f(max_degree))
    do k = max_degree - 1, 0, -1
      size_of = size_of*width + abs(f(k))
    end do
  end function size_of

  !> Whether the motion, within `rest` of the polynomial, has one zero just after y, where the
  !> polynomial is `rest` to `rough`: it falls there, and by 2*rest before its slope can have
  !> halved. The slope of what the polynomial leaves out, r s**6, is at most 6 r s**5; after
  !> `times` divisions by s, (6 + times) times itself over s.
  pure logical function is_isolated(f, y, rest, times, width)
    real(wp), intent(in) :: f(0:max_degree)   !! coefficients
    real(wp), intent(in) :: y                 !! where the polynomial is `rest`
    real(wp), intent(in) :: rest              !! bound of what it leaves out
    integer, intent(in) :: times              !! divisions by s that made it
    real(wp), intent(in) :: width             !! interval
    real(wp) :: slope, span, bend
    integer :: k
    slope = -horner_slope(f, y)
    is_isolated = .false.
    if (slope <= 0) return
    span = 4*rest/slope + 2*rough*width
    bend = 0
    do k = max_degree, 2, -1
      bend = bend*width + k*(k - 1)*abs(f(k))
    end do
    is_isolated = bend*span + (bound_order + times)*rest/width <= 0.5_wp*slope &
        .and. y + span <= width
  end function is_isolated

  !> A zero to the last bits from a guess near to it: the motion's Taylor polynomial about the guess
  !> is exact so near. `polished`: whether it was near enough, and within the bracket.
  pure subroutine polish(scene, curve, panel, goal, least, guess, most, polished, s, x, v)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve         !! arc
    integer, intent(in) :: panel
    type(target_t), intent(in) :: goal         !! what is looked for
    real(wp), intent(in) :: least, guess, most !! bracket and guess
    logical, intent(out) :: polished           !! whether it is found
    real(wp), intent(out) :: s                 !! the zero, or the guess
    real(wp), intent(out) :: x, v              !! position and velocity there
    real(wp) :: f(0:max_degree), c(0:max_degree), rest, slope, move
    call curve_taylor(scene, curve, panel, .false., guess, c, rest)
    call goal_of(goal, c, f, rest)
    polished = .false.
    s = guess
    x = c(0)
    v = c(1)
    move = 0
    call newton(f, -huge(move), huge(move), epsilon(s)*guess, epsilon(s), move, slope, polished)
    if (.not. polished) return
    polished = .false.
    if (guess + move < least .or. guess + move > most &
        .or. rest*abs(move)**max_degree > epsilon(s)*abs(slope)) return
    polished = .true.
    s = guess + move
    x = horner(c, move)
    v = horner_slope(c, move)
  end subroutine polish

  !> The return of a short excursion: the s > 0 where s*(p(0) + p(1) s + ...) = speed.
  !>
  !> Where (k+1)|p(k)| s**k add up to less than p(0)/4 up to s = 1.5 speed/p(0), the left side grows
  !> at 3/4 p(0) at least: there is exactly one return before that time. Otherwise, or where it
  !> lies beyond `limit`, nothing is claimed.
  pure subroutine quick_return(p, speed, limit, found, s)
    real(wp), intent(in) :: p(0:)              !! series of the returning acceleration
    real(wp), intent(in) :: speed              !! speed at the beginning
    real(wp), intent(in) :: limit              !! the series holds up to here
    logical, intent(out) :: found              !! whether there is such a return
    real(wp), intent(out) :: s                 !! when
    real(wp) :: most, power, tail, term, next, value, slope, step
    integer :: i, k, n
    found = .false.
    s = 0
    if (.not. (p(0) > 0 .and. speed > 0)) return
    most = 1.5_wp*speed/p(0)
    if (most > limit) return
    power = 1
    tail = 0
    n = 0
    next = 1
    do k = 1, ubound(p, 1)
      power = power*most
      next = next + 1
      term = next*abs(p(k))*power
      tail = tail + term
      if (term > 0.125_wp*epsilon(s)*p(0)) n = k
    end do
    if (tail > 0.25_wp*p(0)) return
    found = .true.
    s = speed/p(0)
    if (n == 0) return
    s = s*(1 - p(1)*s/p(0))
    do i = 1, max_newton
      value = p(n)
      slope = 0
      do k = n - 1, 0, -1
        slope = slope*s + value
        value = value*s + p(k)
      end do
      step = (speed - s*value)/(value + s*slope)
      s = s + step
      ! Convex or concave by p(0)/(4 most) at most, rising by 3/4 p(0): the error left is below
      ! step**2/(3 most).
      if (step**2 <= epsilon(s)*s*most) return
    end do
  end subroutine quick_return
end module lapwing_flow_exact_root_search
