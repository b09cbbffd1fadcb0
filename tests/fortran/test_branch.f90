!> Equations of periodic motions: flanks, bounces that die out, derivatives, what solves them.
program test_branch
  use, intrinsic :: ieee_arithmetic, only: ieee_is_nan
  use assertions, only: tally_t
  use lapwing_kinds, only: wp
  use lapwing_branch_bordered, only: solve_bordered, once_round
  use lapwing_branch_chatter, only: ball_t, chatter_rest, bounces_of
  use lapwing_branch_curve, only: curve_t, curve_of, piece_at, piece_begin, derivatives, response, &
      rise
  use lapwing_branch_equations, only: motion_t, equations_of, flight, contact, chatter, rest
  implicit none

  real(wp), parameter :: pi = 3.141592653589793238_wp
  integer, parameter :: rebound = 0, go_on = 1, release = 2, chatter_end = 3
  real(wp), target :: nothing(1) = 0, no_q(2, 1, 1) = 0, no_g(6, 1, 1) = 0, no_terms(5, 0)
  real(wp), target :: cosine(5, 1), knots(3) = [0.0_wp, 0.4_wp, 1.0_wp], cubics(6, 4, 2)
  type(tally_t) :: tally

  call test_pieces()
  call test_series()
  call test_rise()
  call test_bounces_on_a_standing_flank()
  call test_bounces_under_jerk()
  call test_bounces_that_go_on()
  call test_one_impact()
  call test_derivatives()
  call test_bordered()
  call test_once_round()
  call tally%finish()

contains

  !> A cos u and the engaged response to it.
  function wave(size_of, period, xi) result(curve)
    real(wp), intent(in) :: size_of, period, xi    !! rad, tau, damping ratio
    type(curve_t) :: curve
    complex(wp) :: q
    real(wp) :: rate
    rate = 2*pi/period
    q = size_of*rate**2/cmplx(1 - rate**2, 2*xi*rate, wp)
    cosine(:, 1) = [1.0_wp, size_of, 0.0_wp, real(q), aimag(q)]
    curve = curve_of(period, nothing, no_g, nothing, no_q, nothing, cosine)
  end function wave

  !> x² + x³ up to 0.4, and a cubic beyond that goes on with the same value and slope.
  function two_cubics(period) result(curve)
    real(wp), intent(in) :: period                 !! tau
    type(curve_t) :: curve
    real(wp) :: c(0:3)
    integer :: k, j, piece
    c = [0.0_wp, 0.0_wp, 1.0_wp, 1.0_wp]
    cubics = 0
    do piece = 1, 2
      do k = 0, 3
        do j = k, 3
          cubics(k + 1, j - k + 1, piece) = c(j)*gamma(j + 1.0_wp)/gamma(j - k + 1.0_wp)/period**k
        end do
      end do
      c = [c(2)*0.16_wp + c(3)*0.064_wp, 0.8_wp*c(2) + 0.48_wp*c(3), -3.0_wp, 2.0_wp]
    end do
    curve = curve_of(period, knots, cubics, nothing, no_q, nothing, no_terms)
  end function two_cubics

  subroutine test_pieces()
    type(curve_t) :: curve
    real(wp) :: d(0:5)
    curve = two_cubics(2.0_wp)
    call tally%equal(piece_at(curve, 0.4_wp), 1, "a knot belongs to the piece that it begins")
    call tally%equal(piece_at(curve, 0.39_wp), 0, "before the knot")
    call tally%equal(piece_at(curve, -0.1_wp), -1, "the last piece of the period before")
    call tally%equal(piece_at(curve, 2.5_wp), 5, "the third period")
    call tally%near(piece_begin(curve, 5), 2.4_wp, 1e-15_wp, "where that piece begins")
    call tally%near(piece_begin(curve, -1), -0.6_wp, 1e-15_wp, "and the one before phase 0")
    d = derivatives(curve, 1.2_wp, 2)
    call tally%near(d(0), 0.048_wp, 1e-15_wp, "g in the next period")
    call tally%near(d(1), 0.26_wp, 1e-15_wp, "g' by tau, two of them a period")
    call tally%near(d(3), 0.75_wp, 1e-15_wp, "g'''")
    ! Beyond its end a piece is the same polynomial.
    d = derivatives(curve, 0.5_wp, 0)
    call tally%near(d(0), 0.375_wp, 1e-15_wp, "g beyond the end of its piece")
  end subroutine test_pieces

  subroutine test_series()
    type(curve_t) :: curve
    real(wp) :: d(0:5), q(2), ahead(2), back(2)
    real(wp), parameter :: xi = 0.1_wp, h = 1e-4_wp
    curve = wave(0.3_wp, 5.0_wp, xi)
    d = derivatives(curve, 0.2_wp, 0)
    call tally%near(d(0), 0.3_wp*cos(0.4_wp*pi), 1e-15_wp, "g of a series")
    call tally%near(d(1), -0.12_wp*pi*sin(0.4_wp*pi), 1e-15_wp, "g' of a series")
    call tally%near(d(5), -0.3_wp*(0.4_wp*pi)**5*sin(0.4_wp*pi), 1e-14_wp, "its fifth derivative")
    ! q'' + 2 xi q' + q = -g''.
    q = response(curve, 0.2_wp, 0)
    ahead = response(curve, 0.2_wp + h, 0)
    back = response(curve, 0.2_wp - h, 0)
    call tally%near((ahead(1) - back(1))/(2*h*5), q(2), 1e-7_wp, "q' is the slope of q")
    call tally%near((ahead(2) - back(2))/(2*h*5) + 2*xi*q(2) + q(1), -d(2), 1e-7_wp, &
        "the equation of the response")
  end subroutine test_series

  subroutine test_rise()
    type(curve_t) :: curve
    real(wp) :: known(0:5), there(0:5), s
    integer :: k
    curve = two_cubics(2.0_wp)
    known = derivatives(curve, 0.3_wp, 0)
    there = derivatives(curve, 0.7_wp, 1)
    call tally%near(rise(curve, 0.3_wp, 0, known, 0.8_wp, .true.), &
        (there(0) - known(0))/0.8_wp - known(1), 1e-15_wp, "over a knot")
    there = derivatives(curve, 0.7_wp, 0)
    call tally%near(rise(curve, 0.3_wp, 0, known, 0.8_wp, .false.), &
        (there(0) - known(0))/0.8_wp - known(1), 1e-15_wp, "on the piece of its beginning")
    ! However short: g'' s/2 + g''' s²/6.
    do k = 1, 12
      s = 10.0_wp**(-k)
      call tally%near(rise(curve, 0.3_wp, 0, known, s, .true.)/(known(2)*s/2 + known(3)*s**2/6), &
          1.0_wp, 1e-14_wp, "a short way on a table")
    end do
    curve = wave(0.3_wp, 5.0_wp, 0.1_wp)
    known = derivatives(curve, 0.2_wp, 0)
    do k = 3, 12
      s = 10.0_wp**(-k)
      call tally%near(rise(curve, 0.2_wp, 0, known, s, .false.) &
          /(known(2)*s/2 + known(3)*s**2/6 + known(4)*s**3/24), 1.0_wp, s**3 + 3e-15_wp, &
          "a short way on a series")
    end do
  end subroutine test_rise

  !> 2u/(F(1 - e)), each bounce e times as fast and long as the one before.
  subroutine test_bounces_on_a_standing_flank()
    type(curve_t) :: curve
    type(ball_t) :: ball
    real(wp) :: length, by_speed, by_time, phases(40), speeds(40)
    integer :: count, k
    curve = wave(0.3_wp, 100.0_wp, 0.1_wp)
    ! Away from the drive flank a force of -2 presses the tooth on the coast flank, which stands.
    ball = ball_t(force=-2.0_wp, restitution=0.7_wp, gap=1.0_wp, back_moves=.false.)
    call chatter_rest(curve, ball, 2, 0.3_wp, 0, 0.5_wp, length, by_speed, by_time)
    call tally%near(length, 2*0.5_wp/(2*0.3_wp), 1e-14_wp, "sum of the bounces")
    call tally%near(by_speed, 2/(2*0.3_wp), 1e-14_wp, "its derivative by the speed")
    call tally%near(by_time, 0.0_wp, 1e-14_wp, "and by the time")
    call bounces_of(curve, ball, 2, 0.3_wp, 0, 0.5_wp, phases, speeds, count)
    call tally%equal(count, 40, "as many as there is room for")
    do k = 1, 40
      call tally%near(speeds(k)/(0.5_wp*0.7_wp**(k - 1)), 1.0_wp, 1e-13_wp, "speed of a bounce")
    end do
    call tally%near(phases(2) - phases(1), 0.7_wp*0.5_wp/100, 1e-15_wp, "time between two")
    call bounces_of(curve, ball, 2, 0.3_wp, 0, 1e-13_wp, phases, speeds, count)
    call tally%equal(count, 0, "too slow to be one")
  end subroutine test_bounces_on_a_standing_flank

  !> Against differences; and T_rest = 2v/(a(1-e)) - 4jv²/(3a³(1-e)²) + O(v³).
  subroutine test_bounces_under_jerk()
    type(curve_t) :: curve
    type(ball_t) :: ball
    real(wp) :: length, by_speed, by_time, more, less, other(2), d(0:5), press, jerk, speed
    real(wp) :: left(2)
    integer :: k
    real(wp), parameter :: h = 1e-5_wp
    curve = wave(0.3_wp, 2*pi, 0.1_wp)
    ball = ball_t(force=1.0_wp, restitution=0.6_wp, gap=10.0_wp)
    call chatter_rest(curve, ball, 1, 0.2_wp, 0, 0.2_wp, length, by_speed, by_time)
    call chatter_rest(curve, ball, 1, 0.2_wp, 0, 0.2_wp + h, more, other(1), other(2))
    call chatter_rest(curve, ball, 1, 0.2_wp, 0, 0.2_wp - h, less, other(1), other(2))
    call tally%near(by_speed, (more - less)/(2*h), 1e-8_wp, "derivative by the speed")
    call chatter_rest(curve, ball, 1, 0.2_wp + h, 0, 0.2_wp, more, other(1), other(2))
    call chatter_rest(curve, ball, 1, 0.2_wp - h, 0, 0.2_wp, less, other(1), other(2))
    call tally%near(by_time, (more - less)/(2*h*2*pi), 1e-8_wp, "derivative by the time")
    d = derivatives(curve, 0.2_wp, 0)
    press = ball%force - d(2)
    jerk = -d(3)
    do k = 1, 2
      speed = 0.02_wp/2**k
      call chatter_rest(curve, ball, 1, 0.2_wp, 0, speed, length, by_speed, by_time)
      left(k) = length - 2*speed/(press*0.4_wp) + 4*jerk*speed**2/(3*press**3*0.16_wp)
    end do
    call tally%near(left(1)/left(2), 8.0_wp, 0.2_wp, "what is left is of the third order")
  end subroutine test_bounces_under_jerk

  subroutine test_bounces_that_go_on()
    type(curve_t) :: curve
    type(ball_t) :: ball
    real(wp) :: length, by_speed, by_time
    curve = wave(1.0_wp, 2*pi, 0.1_wp)
    ball = ball_t(force=0.5_wp, restitution=0.6_wp, gap=10.0_wp)
    ! At u = pi the flank falls away: F < g'' = 1.
    call chatter_rest(curve, ball, 1, 0.5_wp, 0, 0.1_wp, length, by_speed, by_time)
    call tally%is_true(ieee_is_nan(length), "not pressed, the bounces do not die out")
    ball%restitution = 1
    call chatter_rest(curve, ball, 1, 0.0_wp, 0, 1e-3_wp, length, by_speed, by_time)
    call tally%is_true(ieee_is_nan(length), "nothing is lost, the bounces do not die out")
  end subroutine test_bounces_that_go_on

  !> The ball: sin u = pi(1-e)/(G(1+e)), 2 pi F/(1+e) fast; trace 1 + e² + (1+e)² G cos u, det e².
  subroutine test_one_impact()
    type(motion_t) :: motion
    real(wp) :: u, z(2), residual(2, 1), one(2, 2, 1), two(2, 2, 1), trace, det
    real(wp), parameter :: e = 0.7_wp, g = 0.9_wp
    integer :: rank
    motion = motion_t(wave(1.0_wp, 2*pi, 0.1_wp), ball_t(force=1/g, restitution=e, gap=1e3_wp), &
        scale=2.0_wp)
    u = pi - asin(pi*(1 - e)/(g*(1 + e)))
    z = [u/(2*pi), 2*pi/g/(1 + e)*2*pi/motion%scale]
    call equations_of(motion, reshape([rebound, 1, 0, flight], [4, 1]), [0.0_wp], z, residual, &
        one, two)
    call tally%near(maxval(abs(residual)), 0.0_wp, 1e-14_wp, "the closed form solves them")
    call once_round(one, two, trace, det, rank)
    call tally%near(trace, 1 + e**2 + (1 + e)**2*g*cos(u), 1e-13_wp, "trace once round")
    call tally%near(det, e**2, 1e-14_wp, "determinant once round")
    call tally%equal(rank, 2, "rank once round")
  end subroutine test_one_impact

  !> Every arc, flank and law: derivatives are those of the residuals.
  subroutine test_derivatives()
    type(curve_t) :: slow
    type(ball_t) :: ball
    integer, parameter :: both(4, 2) = &
        reshape([rebound, 1, 0, flight, rebound, 2, 0, flight], [4, 2])
    integer, parameter :: pressed(4, 2) = &
        reshape([go_on, 1, 0, flight, release, 1, 0, contact], [4, 2])
    integer, parameter :: back(4, 2) = &
        reshape([go_on, 2, 0, flight, release, 2, 0, contact], [4, 2])
    integer, parameter :: died(4, 3) = reshape([rebound, 1, 0, flight, chatter_end, 1, 0, chatter, &
        release, 1, 0, rest], [4, 3])
    integer :: law
    logical :: absolute
    slow = wave(0.3_wp, 5.0_wp, 0.1_wp)
    ball = ball_t(force=1.0_wp, restitution=0.6_wp, gap=2.0_wp)
    do law = 1, 2
      absolute = law == 2
      call compare(motion_t(slow, ball, 0.1_wp, absolute), both, &
          [0.2_wp, 1.3_wp, 0.7_wp, 0.9_wp], "from flank to flank")
      call compare(motion_t(slow, ball_t(1.0_wp, 0.6_wp, 2.0_wp, .false.), 0.1_wp, absolute), &
          both, [0.2_wp, 1.3_wp, 0.7_wp, 0.9_wp], "to a flank that stands")
      call compare(motion_t(slow, ball, 0.1_wp, absolute), pressed, &
          [0.1_wp, 0.8_wp, 0.55_wp, -0.6_wp], "through a contact after an impact")
      call compare(motion_t(slow, ball, 0.1_wp, .false., .false.), back, &
          [0.1_wp, 0.8_wp, 0.55_wp, -0.6_wp], "through the coast flank, which gives way")
      call compare(motion_t(slow, ball, 0.1_wp, absolute), died, &
          [0.8_wp, 0.8_wp, 1.0_wp, 0.0_wp, 1.2_wp, 0.0_wp], "through a complete chatter")
    end do
  end subroutine test_derivatives

  subroutine compare(motion, layout, z, what)
    type(motion_t), intent(in) :: motion       !! what moves
    integer, intent(in) :: layout(:, :)        !! its events
    real(wp), intent(in) :: z(:)               !! where they are
    character(*), intent(in) :: what           !! in words
    real(wp), parameter :: h = 1e-5_wp
    real(wp) :: jumps(size(layout, 2)), x(size(z)), found(2, size(layout, 2), 2)
    real(wp) :: largest, expected
    real(wp), dimension(2, 2, size(layout, 2)) :: one, two, unused, not_used
    integer :: n, j, k, way, event, unknown
    n = size(layout, 2)
    jumps = 0
    call equations_of(motion, layout, jumps, z, found(:, :, 1), one, two)
    largest = 0
    do k = 1, size(z)
      event = (k + 1)/2
      unknown = 2 - modulo(k, 2)
      do way = 1, 2
        x = z
        x(k) = x(k) + merge(h, -h, way == 1)
        call equations_of(motion, layout, jumps, x, found(:, :, way), unused, not_used)
      end do
      do j = 1, n
        do way = 1, 2
          expected = (found(way, j, 1) - found(way, j, 2))/(2*h)
          if (j == event) expected = expected - two(way, unknown, j)
          if (modulo(j - 2, n) + 1 == event) expected = expected - one(way, unknown, j)
          largest = max(largest, abs(expected))
        end do
      end do
    end do
    call tally%below(largest, 1e-7_wp, "derivatives of the equations " // what)
  end subroutine compare

  !> Against the residual of what is solved for, with blocks that are nowhere near regular alone.
  subroutine test_bordered()
    integer, parameter :: n = 5
    real(wp) :: one(2, 2, n), two(2, 2, n), column(2*n), row(2*n + 1), right(2*n + 1), &
        kept(2, 8, n), x(2*n + 1), left(2*n + 1)
    integer :: j, last
    call fill(one, two, column, row, right)
    two(:, :, 3) = reshape([1.0_wp, 2.0_wp, 1.0_wp, 2.0_wp], [2, 2])
    call solve_bordered(one, two, column, row, right, kept, x)
    do j = 1, n
      last = modulo(j - 2, n) + 1
      left(2*j - 1:2*j) = matmul(one(:, :, j), x(2*last - 1:2*last)) &
          + matmul(two(:, :, j), x(2*j - 1:2*j)) + column(2*j - 1:2*j)*x(2*n + 1) &
          - right(2*j - 1:2*j)
    end do
    left(2*n + 1) = dot_product(row, x) - right(2*n + 1)
    call tally%below(maxval(abs(left)), 1e-12_wp, "what is solved solves the equations")
    ! A motion with one event is linked with itself.
    call solve_bordered(one(:, :, :1), two(:, :, :1), column(:2), row(:3), right(:3), kept, &
        x(:3))
    left(:2) = matmul(one(:, :, 1) + two(:, :, 1), x(:2)) + column(:2)*x(3) - right(:2)
    left(3) = dot_product(row(:3), x(:3)) - right(3)
    call tally%below(maxval(abs(left(:3))), 1e-13_wp, "one event alone")
  end subroutine test_bordered

  !> Numbers without a pattern.
  subroutine fill(one, two, column, row, right)
    real(wp), intent(out) :: one(:, :, :), two(:, :, :), column(:), row(:), right(:)  !! all of it
    integer :: k, j, i
    do k = 1, size(one, 3)
      do j = 1, 2
        do i = 1, 2
          one(i, j, k) = sin(1.7_wp*i + 3.1_wp*j + 5.3_wp*k)
          two(i, j, k) = cos(2.9_wp*i + 1.3_wp*j + 4.7_wp*k)
        end do
      end do
    end do
    column = [(sin(0.7_wp*k*k), k = 1, size(column))]
    row = [(cos(1.1_wp*k*k), k = 1, size(row))]
    right = [(sin(2.3_wp*k + 0.4_wp), k = 1, size(right))]
  end subroutine fill

  !> Products of -two⁻¹ one, very large and very small ones among them.
  subroutine test_once_round()
    real(wp) :: one(2, 2, 400), two(2, 2, 400), trace, det
    integer :: rank, k
    two = 0
    two(1, 1, :) = -1
    two(2, 2, :) = -1
    do k = 1, 400
      one(:, :, k) = reshape([0.0_wp, 1.0_wp, -1.0_wp, 0.5_wp], [2, 2])
      one(:, :, k) = one(:, :, k)*merge(1e3_wp, 1e-3_wp, k <= 200)
    end do
    call once_round(one, two, trace, det, rank)
    ! Each turns by acos(1/4); on the way the product is 1e600.
    call tally%near(trace, 2*cos(400*acos(0.25_wp)), 1e-11_wp, "trace of many turns")
    call tally%near(det, 1.0_wp, 1e-11_wp, "determinant of many turns")
    one(:, 2, 7) = 0
    call once_round(one, two, trace, det, rank)
    call tally%equal(rank, 1, "a complete chatter leaves one direction")
    call tally%near(det, 0.0_wp, 0.0_wp, "and no determinant")
    one(:, :, 8) = 0
    call once_round(one, two, trace, det, rank)
    call tally%equal(rank, 0, "a rest leaves none")
    call tally%near(trace, 0.0_wp, 0.0_wp, "and no trace")
    two(:, :, 9) = 0
    call once_round(one(:, :, 9:), two(:, :, 9:), trace, det, rank)
    call tally%is_true(ieee_is_nan(trace), "an event that does not follow from the one before")
  end subroutine test_once_round

end program test_branch
