!> The first crossing of a position by a smooth arc: against dense samples, at grazing from
!> both sides, at double roots, from a touching start; turns; short returns.
program test_first_crossing
  use assertions, only: tally_t
  use exact_reference, only: qp, seed, uniform, random_scene, amplification, longest_rate, &
      largest_term
  use lapwing_flow_exact_root_search, only: target_t, first_crossing, first_turn, quick_return, &
      only_zero
  use lapwing_system_oscillation, only: n_taylor
  use lapwing_kinds, only: wp
  use lapwing_polynomial_evaluation, only: max_degree, taylor_shift, bernstein_on
  use lapwing_flank, only: locate_piece
  use lapwing_flow_exact_curve, only: scene_t, curve_t, begin_curve, expand_fully
  use lapwing_flow_exact_motion, only: curve_at, acceleration_at
  use lapwing_flow_exact_panels, only: locate_panel
  implicit none

  type(tally_t) :: tally
  real(wp), parameter :: eps = epsilon(1.0_wp)
  integer, parameter :: n_curves = 3000, n_samples = 200

  call seed(20261125)
  call test_against_samples()
  call test_grazing()
  call test_touching_start()
  call test_turns()
  call test_parabola_returns()
  call test_returns_against_bisection()
  call test_returns_refused()
  call test_only_zero()
  call tally%finish()

contains

  !> An arc, and the part of it in one panel: the first one or a later one.
  subroutine random_part(number, scene, curve, panel, from, to)
    integer, intent(in) :: number            !! decides what it is
    type(scene_t), intent(out) :: scene      !! scene
    type(curve_t), intent(out) :: curve      !! arc
    integer, intent(out) :: panel            !! panel
    real(wp), intent(out) :: from, to        !! the part, times since the arc began
    real(wp) :: t
    call random_scene(mod(number, 2) == 0, 0.0_wp, scene)
    t = uniform(0.0_wp, scene%form%period)
    call begin_curve(scene, mod(number/2, 2) == 0, t, locate_piece(scene%flank, t, 1), &
        uniform(-1.0_wp, 1.0_wp), uniform(-1.0_wp, 1.0_wp), curve)
    call expand_fully(scene, curve)
    panel = locate_panel(scene%form, t)
    from = 0
    if (mod(number/4, 2) == 0 .and. panel < scene%form%n) then
      panel = panel + 1
      from = scene%form%edge(panel) - t
    end if
    to = scene%form%edge(panel + 1) - t
  end subroutine random_part

  !> Rounding of a position.
  real(wp) function rounding(scene, curve)
    type(scene_t), intent(in) :: scene       !! scene
    type(curve_t), intent(in) :: curve       !! arc
    real(wp) :: bend
    bend = 1 + largest_term(scene, 2)
    rounding = eps*(40*(abs(curve%x) + abs(curve%v) + 5)*6 &
        + (200 + 10*scene%form%n)*(bend + amplification(scene)))
  end function rounding

  !> `first_crossing` from a panel's or from the arc's beginning, which says where it is as well.
  subroutine cross(scene, curve, panel, goal, from, to, found, s)
    type(scene_t), intent(in) :: scene       !! scene
    type(curve_t), intent(in) :: curve       !! arc
    integer, intent(in) :: panel             !! panel
    type(target_t), intent(in) :: goal       !! what is looked for
    real(wp), intent(in) :: from, to         !! where
    logical, intent(out) :: found            !! whether it is met
    real(wp), intent(out) :: s               !! when
    real(wp) :: x, v, at(2)
    call first_crossing(scene, curve, panel, from > 0, goal, from, to, found, s, x, v)
    if (.not. found) return
    call curve_at(scene, curve, panel, s, at(1), at(2))
    call tally%near(x, at(1), rounding(scene, curve), "position said")
    call tally%near(v, at(2), 8*rounding(scene, curve), "velocity said")
  end subroutine cross

  !> More than the third derivative of any motion here, whose x and v are below 10.
  real(wp) function jerk_bound(scene)
    type(scene_t), intent(in) :: scene       !! scene
    jerk_bound = 400*longest_rate(scene)**3
    jerk_bound = jerk_bound + 60*(1 + scene%form%period)**2*largest_term(scene, 3)
  end function jerk_bound

  !> Smallest distance on an even grid of (from, until).
  real(wp) function least_sample(scene, curve, panel, goal, from, until) result(least)
    type(scene_t), intent(in) :: scene       !! scene
    type(curve_t), intent(in) :: curve       !! arc
    integer, intent(in) :: panel             !! panel
    type(target_t), intent(in) :: goal       !! what is looked for
    real(wp), intent(in) :: from, until      !! interval
    real(wp) :: x, v
    integer :: i
    least = huge(least)
    do i = 1, n_samples - 1
      call curve_at(scene, curve, panel, from + (until - from)*i/n_samples, x, v)
      least = min(least, goal%sign*(x - goal%wall))
    end do
  end function least_sample

  !> What is found is a zero, and nothing lies before it; where nothing is found nothing is there.
  subroutine test_against_samples()
    type(scene_t) :: scene
    type(curve_t) :: curve
    type(target_t) :: goal
    real(wp) :: from, to, s, x, v, allowed
    integer :: i, panel, hits
    logical :: found
    hits = 0
    do i = 1, n_curves
      call random_part(i, scene, curve, panel, from, to)
      call curve_at(scene, curve, panel, from, x, v)
      goal%sign = merge(1.0_wp, -1.0_wp, mod(i, 3) == 0)
      goal%wall = x - goal%sign*10.0_wp**uniform(-9.0_wp, 0.0_wp)
      goal%touching = .false.
      call cross(scene, curve, panel, goal, from, to, found, s)
      allowed = rounding(scene, curve)
      if (found) then
        hits = hits + 1
        call tally%is_true(from <= s .and. s <= to, "met within the time searched")
        call curve_at(scene, curve, panel, s, x, v)
        call tally%near(x, goal%wall, allowed + 2*spacing(to)*abs(v), "position where it is met")
        to = s
      end if
      call tally%below(-least_sample(scene, curve, panel, goal, from, to), allowed, &
          "distance before the crossing")
    end do
    call tally%below(0.2_wp*n_curves, real(hits, wp), "walls met")
    call tally%below(0.2_wp*n_curves, real(n_curves - hits, wp), "walls not met")
  end subroutine test_against_samples

  !> A wall at the turn of the motion and 1e-9 to 1e-13 of its size on either side: met where the
  !> motion reaches it, at sqrt(2 delta/a) before the turn, and otherwise not.
  subroutine test_grazing()
    real(wp), parameter :: deltas(6) = [1.0e-6_wp, 1.0e-9_wp, 1.0e-10_wp, 1.0e-11_wp, 1.0e-12_wp, &
        1.0e-13_wp]
    type(scene_t) :: scene
    type(curve_t) :: curve
    type(target_t) :: goal
    real(wp) :: from, to, turn, x, v, a, s, allowed, lead
    integer :: i, k, panel, grazes
    logical :: found
    grazes = 0
    do i = 1, n_curves
      call random_part(i, scene, curve, panel, from, to)
      call first_turn(scene, curve, panel, .false., from, to, found, turn)
      if (.not. found .or. turn <= from + 0.02_wp .or. turn >= to - 0.02_wp) cycle
      call curve_at(scene, curve, panel, turn, x, v)
      a = acceleration_at(scene, curve, panel, turn, x, v)
      if (abs(a) < 0.1_wp) cycle
      ! Behind the next turn the wall may be met anyway.
      call first_turn(scene, curve, panel, .true., turn, to, found, s)
      if (found) to = s
      grazes = grazes + 1
      allowed = rounding(scene, curve)
      goal%sign = sign(1.0_wp, a)
      goal%touching = .false.
      do k = 1, 6
        ! Never within what rounds away: on which side of it the motion passes is not known.
        if (deltas(k) < 2*allowed) exit
        goal%wall = x - goal%sign*deltas(k)
        call cross(scene, curve, panel, goal, from, to, found, s)
        call tally%is_true(.not. found, "passed at a distance")
        goal%wall = x + goal%sign*deltas(k)
        call cross(scene, curve, panel, goal, from, to, found, s)
        call tally%is_true(found, "grazed")
        if (.not. found) cycle
        lead = sqrt(2*deltas(k)/abs(a))
        ! The third derivative changes it by a part lead*|x'''|/(3a), rounding by a part of
        ! allowed/delta.
        call tally%near(turn - s, lead, lead*(allowed/deltas(k) &
            + jerk_bound(scene)*lead/abs(a)) + 4*spacing(to), "how long before the turn")
      end do
      ! A double root: met there or not, but nowhere else.
      goal%wall = x
      call cross(scene, curve, panel, goal, from, to, found, s)
      if (found) call tally%near(s, turn, 4*sqrt(2*allowed/abs(a)), "double root")
    end do
    call tally%below(200.0_wp, real(grazes, wp), "grazes")
    print "(a, i0)", "measured: grazes tried ", grazes
  end subroutine test_grazing

  !> An arc that leaves a wall is not back at once; it returns when it returns, however soon.
  subroutine test_touching_start()
    type(scene_t) :: scene
    type(curve_t) :: curve
    type(target_t) :: goal
    real(wp) :: t, to, s, x, v, speed, a, first
    integer :: i, panel, returns
    logical :: found
    returns = 0
    do i = 1, n_curves
      call random_scene(mod(i, 2) == 0, 0.0_wp, scene)
      t = uniform(0.0_wp, scene%form%period)
      panel = locate_panel(scene%form, t)
      to = scene%form%edge(panel + 1) - t
      goal%sign = merge(1.0_wp, -1.0_wp, mod(i, 3) == 0)
      goal%wall = 0
      goal%touching = .true.
      speed = 10.0_wp**uniform(-12.0_wp, 0.0_wp)
      call begin_curve(scene, mod(i/2, 2) == 0, t, locate_piece(scene%flank, t, 1), 0.0_wp, &
          goal%sign*speed, curve)
      call expand_fully(scene, curve)
      a = -goal%sign*acceleration_at(scene, curve, panel, 0.0_wp, 0.0_wp, goal%sign*speed)
      call cross(scene, curve, panel, goal, 0.0_wp, to, found, s)
      if (found) then
        returns = returns + 1
        call tally%is_true(s > 0, "not met where it is left")
        call curve_at(scene, curve, panel, s, x, v)
        ! Relative to the excursion while its series holds; after that as all positions round.
        call tally%below(abs(x), 8*eps*(speed*s + 40*longest_rate(scene)**2*s**2) &
            + spacing(to)*abs(v) + merge(rounding(scene, curve), 0.0_wp, s > curve%near), &
            "position where it comes back")
        ! Only what pulls it back brings it back soon: speed = a s/2 and an order more.
        first = 2*speed/a
        if (a > 0.1_wp .and. first < 1.0e-5_wp) call tally%near(s, first, &
            first**2*jerk_bound(scene)/a, "return of a small excursion")
        to = s
      else
        call tally%is_true(.not. (a > 0.1_wp .and. 4*speed/a < min(to, 1.0e-5_wp)), &
            "a small excursion that must come back")
      end if
      call tally%below(-least_sample(scene, curve, panel, goal, 0.0_wp, to), &
          merge(rounding(scene, curve), 4*eps*speed*to, to > 1.0e-3_wp), "distance before that")
    end do
    call tally%below(0.1_wp*n_curves, real(returns, wp), "returns")
  end subroutine test_touching_start

  !> The velocity is zero at a turn and of one sign before it.
  subroutine test_turns()
    type(scene_t) :: scene
    type(curve_t) :: curve
    real(wp) :: from, to, s, x, v, before, at, allowed
    integer :: i, k, panel, turns
    logical :: found
    turns = 0
    do i = 1, n_curves
      call random_part(i, scene, curve, panel, from, to)
      allowed = 8*rounding(scene, curve)
      call first_turn(scene, curve, panel, .false., from, to, found, s)
      at = merge(s, to, found)
      call curve_at(scene, curve, panel, from, x, before)
      do k = 1, n_samples - 1
        call curve_at(scene, curve, panel, from + (at - from)*k/n_samples, x, v)
        call tally%below(-sign(1.0_wp, before)*v, allowed, "velocity before a turn")
      end do
      if (.not. found) cycle
      turns = turns + 1
      call curve_at(scene, curve, panel, s, x, v)
      call tally%below(abs(v), allowed, "velocity at a turn")
      ! From a turn on: the next one is another one.
      call first_turn(scene, curve, panel, .true., s, to, found, at)
      if (found) call tally%is_true(at > s, "the next turn is later")
    end do
    call tally%below(0.1_wp*n_curves, real(turns, wp), "turns")
  end subroutine test_turns

  !> s = speed/a, rounded once.
  subroutine test_parabola_returns()
    real(wp) :: speed, s, a
    integer :: i
    logical :: found
    do i = 1, 200
      a = 10.0_wp**uniform(-8.0_wp, 8.0_wp)
      speed = 10.0_wp**uniform(-300.0_wp, 3.0_wp)
      call quick_return([a, 0.0_wp, 0.0_wp, 0.0_wp], speed, huge(s), found, s)
      call tally%is_true(found .and. s == speed/a, "return of a parabola")
    end do
  end subroutine test_parabola_returns

  !> s (p0 + p1 s + ...) = speed, by bisection in quadruple precision.
  subroutine test_returns_against_bisection()
    real(wp) :: p(0:11), speed, s, most
    integer :: i, k, hits
    logical :: found
    hits = 0
    do i = 1, 4000
      p(0) = uniform(0.01_wp, 2.0_wp)
      do k = 1, 11
        p(k) = uniform(-1.0_wp, 1.0_wp)*3.0_wp**k/gamma(k + 2.0_wp)
      end do
      speed = 10.0_wp**uniform(-15.0_wp, 0.0_wp)
      most = 10.0_wp**uniform(-3.0_wp, 0.0_wp)
      call quick_return(p, speed, most, found, s)
      if (.not. found) cycle
      hits = hits + 1
      call tally%near(s, real(bisected(p, speed), wp), 4*eps*s, "return")
      call tally%is_true(s <= most, "within where its series holds")
    end do
    call tally%below(1000.0_wp, real(hits, wp), "returns")
  end subroutine test_returns_against_bisection

  function bisected(p, speed) result(s)
    real(wp), intent(in) :: p(0:), speed     !! see quick_return
    real(qp) :: s, low, high, value
    integer :: i, k
    low = 0
    high = 1.5_qp*speed/p(0)
    do i = 1, 113
      s = 0.5_qp*(low + high)
      value = 0
      do k = ubound(p, 1), 0, -1
        value = value*s + p(k)
      end do
      if (value*s < speed) then
        low = s
      else
        high = s
      end if
    end do
  end function bisected

  subroutine test_returns_refused()
    real(wp) :: s
    logical :: found
    call quick_return([-1.0_wp, 0.0_wp], 1.0_wp, 10.0_wp, found, s)
    call tally%is_true(.not. found, "pulled away")
    call quick_return([0.0_wp, 0.0_wp], 1.0_wp, 10.0_wp, found, s)
    call tally%is_true(.not. found, "not pulled")
    call quick_return([1.0_wp, 0.0_wp], -1.0_wp, 10.0_wp, found, s)
    call tally%is_true(.not. found, "moving in")
    call quick_return([1.0_wp, 0.0_wp], 1.0_wp, 1.49_wp, found, s)
    call tally%is_true(.not. found, "beyond where the series holds")
    call quick_return([1.0_wp, 0.09_wp], 1.0_wp, 10.0_wp, found, s)
    call tally%is_true(.not. found, "the pull changes by more than a quarter")
    call quick_return([1.0_wp, 0.08_wp], 1.0_wp, 10.0_wp, found, s)
    call tally%is_true(found, "or by less")
    call quick_return([1.0_wp, -0.6_wp], 1.0_wp, 10.0_wp, found, s)
    call tally%is_true(.not. found, "it never comes back")
  end subroutine test_returns_refused

  !> A function of a panel, its first terms' Bernstein coefficients, and the bound of the others.
  subroutine random_panel(c, half, b, rest)
    real(wp), intent(out) :: c(0:n_taylor)     !! series about the middle
    real(wp), intent(out) :: half              !! half the width
    real(wp), intent(out) :: b(0:max_degree)   !! coefficients
    real(wp), intent(out) :: rest              !! bound
    real(wp) :: low(0:max_degree), choose, factorial
    integer :: k
    half = 10.0_wp**uniform(-3.0_wp, -0.2_wp)
    choose = 1
    rest = 0
    factorial = 1
    do k = 0, n_taylor
      if (k > 0) factorial = factorial*k
      c(k) = uniform(-1.0_wp, 1.0_wp)/factorial
      if (k <= max_degree) cycle
      rest = rest + choose*abs(c(k))*half**k
      choose = choose*(k + 1)/real(k - max_degree, wp)
    end do
    c(0) = c(0)*half
    low = c(0:max_degree)
    call taylor_shift(low, -half)
    b = bernstein_on(low, 2*half)
  end subroutine random_panel

  !> Where a single zero is claimed, the function is positive before it and negative after it.
  subroutine test_only_zero()
    real(wp) :: c(0:n_taylor), half, b(0:max_degree), rest, u, slope
    real(qp) :: x, size
    integer :: i, k, claimed, missed
    logical :: found
    claimed = 0
    missed = 0
    do i = 1, 10*n_curves
      call random_panel(c, half, b, rest)
      call only_zero(c, half, b, rest, found, u, slope)
      if (.not. found) then
        if (b(0) > 0.1_wp*half .and. b(max_degree) < -0.1_wp*half) missed = missed + 1
        cycle
      end if
      claimed = claimed + 1
      size = sum(abs(c)*half**[(k, k = 0, n_taylor)])
      ! One rounding of each term and sum in two chains of eight, and one of u.
      call tally%near(real(value_of(c, real(u, qp)), wp), 0.0_wp, real(20*eps*size, wp), "zero")
      call tally%near(slope, real((value_of(c, u + 1.0e-12_qp) - value_of(c, u - 1.0e-12_qp)) &
          /2.0e-12_qp, wp), 40*eps*(1 + abs(slope)), "slope at the zero")
      do k = 0, 50
        x = -half + 2*half*(k/50.0_qp)
        if (abs(x - u) < 1.0e-6_wp*half) cycle
        call tally%is_true(value_of(c, x) > 0 .eqv. x < u, "sign on either side")
      end do
    end do
    call tally%below(2000.0_wp, real(claimed, wp), "single zeros")
    call tally%below(real(missed, wp), 0.2_wp*claimed, "zeros left to a search")
    print "(a, i0, a, i0)", "measured: single zeros claimed ", claimed, ", searched for ", missed
  end subroutine test_only_zero

  pure real(qp) function value_of(c, x)
    real(wp), intent(in) :: c(0:n_taylor)    !! coefficients
    real(qp), intent(in) :: x                !! argument
    integer :: k
    value_of = 0
    do k = n_taylor, 0, -1
      value_of = value_of*x + c(k)
    end do
  end function value_of
end program test_first_crossing
