!> Random scenes for the tests of motion in closed form, and that motion by another route: Taylor
!> series of the differential equation itself, of order 30, in quadruple precision.
module exact_reference
  use, intrinsic :: iso_fortran_env, only: qp => real128
  use lapwing_flank_fixed, only: fixed_flank_t, make_fixed_flank
  use lapwing_flank_series, only: series_flank_t, make_series_flank, harmonic_series
  use lapwing_kinds, only: wp
  use lapwing_polynomial_evaluation, only: max_degree
  use lapwing_flank_table, only: te_table_t, make_table
  use lapwing_flow_exact_curve, only: scene_t
  use lapwing_flow_exact_panels, only: most_panels
  use lapwing_flow_exact_response, only: make_closed_form, make_form_at_rest
  implicit none
  private
  public :: qp, seed, uniform, chance, pick, random_table, random_series, table_scene, series_scene
  public :: random_scene, slow_scene, quad_flank, quad_flow, quad_acceleration, longest_rate
  public :: amplification, largest_term, scene_at_rest

  integer, parameter :: order = 30               !! of the reference's steps
  !> Steps of this over the fastest rate leave out 0.25**31 of a term: nothing.
  real(qp), parameter :: step_span = 0.25_qp
  real(wp), parameter :: two_pi = 8*atan(1.0_wp)

contains

  subroutine seed(number)
    integer, intent(in) :: number   !! which of the repeatable sequences
    integer :: n
    call random_seed(size=n)
    call random_seed(put=spread(number, 1, n))
  end subroutine seed

  real(wp) function uniform(low, high)
    real(wp), intent(in) :: low, high   !! limits
    call random_number(uniform)
    uniform = low + (high - low)*uniform
  end function uniform

  logical function chance(share)
    real(wp), intent(in) :: share       !! probability
    chance = uniform(0.0_wp, 1.0_wp) < share
  end function chance

  !> One of several numbers.
  real(wp) function pick(values)
    real(wp), intent(in) :: values(:)   !! the numbers
    pick = values(min(size(values), 1 + int(uniform(0.0_wp, 1.0_wp)*size(values))))
  end function pick

  !> A continuous table of quintic pieces over mesh phase, of size 1, its slope continuous but at
  !> kinks: Hermite cubics plus x**2 (h - x)**2 times a line.
  subroutine random_table(n, share, knots, coefficients, kinks)
    integer, intent(in) :: n                                  !! pieces
    real(wp), intent(in) :: share                             !! of kinks among the knots
    real(wp), allocatable, intent(out) :: knots(:)            !! (n + 1)
    real(wp), allocatable, intent(out) :: coefficients(:, :)  !! (0:5, n)
    logical, allocatable, intent(out) :: kinks(:)             !! (n)
    real(wp) :: value(n + 1), left(n + 1), right(n + 1), h, rise, a, b
    integer :: i
    allocate (knots(n + 1), coefficients(0:max_degree, n), kinks(n))
    knots(1) = 0
    do i = 1, n
      knots(i + 1) = knots(i) + uniform(0.2_wp, 1.0_wp)
      kinks(i) = chance(share)
      value(i) = uniform(-0.5_wp, 0.5_wp)
      right(i) = uniform(-2.0_wp, 2.0_wp)
      left(i) = right(i)
      if (kinks(i)) left(i) = uniform(-2.0_wp, 2.0_wp)
    end do
    knots = knots/knots(n + 1)
    value(n + 1) = value(1)
    left(n + 1) = left(1)
    do i = 1, n
      h = knots(i + 1) - knots(i)
      rise = (value(i + 1) - value(i))/h
      a = uniform(-1.0_wp, 1.0_wp)/h**2
      b = uniform(-1.0_wp, 1.0_wp)/h**3
      coefficients(0:1, i) = [value(i), right(i)]
      coefficients(2, i) = (3*rise - 2*right(i) - left(i + 1))/h + a*h**2
      coefficients(3, i) = (right(i) + left(i + 1) - 2*rise)/h**2 - 2*a*h + b*h**2
      coefficients(4:5, i) = [a - 2*b*h, b]
    end do
  end subroutine random_table

  !> A constant and a few harmonics of size 1.
  function random_series(n) result(series)
    integer, intent(in) :: n            !! harmonics
    real(wp) :: series(3, n + 1)        !! order, amplitude, shift
    integer :: i
    series(:, 1) = [0.0_wp, uniform(-1.0_wp, 1.0_wp), 0.4_wp]
    do i = 1, n
      series(:, i + 1) = [real(i, wp), uniform(-0.5_wp, 0.5_wp)/i, uniform(0.0_wp, two_pi)]
    end do
  end function random_series

  !> Scene over a table.
  function table_scene(knots, coefficients, kinks, period, xi, force, most) result(scene)
    real(wp), intent(in) :: knots(:)              !! mesh phase
    real(wp), intent(in) :: coefficients(0:, :)   !! over mesh phase
    logical, intent(in) :: kinks(:)               !! slope jumps
    real(wp), intent(in) :: period, xi, force     !! P, damping ratio, F
    integer, intent(in), optional :: most         !! panels before it is graded
    type(scene_t) :: scene
    type(te_table_t), pointer :: table
    integer :: panels, error
    panels = most_panels
    if (present(most)) panels = most
    scene%force = force
    allocate (table)
    call make_table(knots, coefficients, kinks, 1.0_wp, period, 0.0_wp, table, error)
    scene%flank => table
    call make_closed_form(table, xi, period, panels, scene%form, error)
  end function table_scene

  !> Scene over a harmonic series.
  function series_scene(series, period, xi, force, most) result(scene)
    real(wp), intent(in) :: series(:, :)          !! order, amplitude, shift
    real(wp), intent(in) :: period, xi, force     !! P, damping ratio, F
    integer, intent(in), optional :: most         !! panels before it is graded
    type(scene_t) :: scene
    type(series_flank_t), pointer :: flank
    integer :: panels, error
    panels = most_panels
    if (present(most)) panels = most
    scene%force = force
    allocate (flank)
    call make_series_flank(harmonic_series(series, 1.0_wp, two_pi/period), period, flank, error)
    scene%flank => flank
    call make_closed_form(flank, xi, period, panels, scene%form, error)
  end function series_scene

  !> The same scene seen from a flank that does not move.
  function scene_at_rest(moving) result(scene)
    type(scene_t), intent(in) :: moving           !! seen from one that does
    type(scene_t) :: scene
    type(fixed_flank_t), pointer :: flank
    integer :: error
    scene%force = moving%force
    allocate (flank)
    call make_fixed_flank(moving%form%period, flank, error)
    scene%flank => flank
    call make_form_at_rest(moving%form, scene%form, error)
  end function scene_at_rest

  !> Any of the two, far from undamped resonances, where the response is at most some ten times its
  !> cause.
  subroutine random_scene(harmonic, share, scene)
    logical, intent(in) :: harmonic               !! which of the two
    real(wp), intent(in) :: share                 !! of kinks
    type(scene_t), intent(out) :: scene           !! the scene
    real(wp), allocatable :: knots(:), coefficients(:, :)
    logical, allocatable :: kinks(:)
    real(wp) :: xi, period, force
    xi = pick([0.0_wp, 0.05_wp, 0.1_wp, 0.4_wp, 1 - 1.0e-9_wp, 1.0_wp, 1 + 1.0e-9_wp, 1.3_wp])
    period = two_pi*(real(int(uniform(0.0_wp, 4.0_wp)), wp) + uniform(0.3_wp, 0.7_wp))
    force = uniform(-1.0_wp, 2.0_wp)
    if (harmonic) then
      scene = series_scene(random_series(1 + int(uniform(0.0_wp, 4.0_wp))), period, xi, force)
    else
      call random_table(1 + int(uniform(0.0_wp, 9.0_wp)), share, knots, coefficients, kinks)
      if (size(kinks) == 1) kinks = .true.
      scene = table_scene(knots, coefficients, kinks, period, xi, force)
    end if
  end subroutine random_scene

  !> A graded scene: the mesh slow against the spring, the damper, both or neither.
  subroutine slow_scene(harmonic, scene)
    logical, intent(in) :: harmonic               !! a series, or a table
    type(scene_t), intent(out) :: scene           !! the scene
    real(wp), allocatable :: knots(:), coefficients(:, :)
    logical, allocatable :: kinks(:)
    real(wp) :: xi, period
    xi = pick([0.01_wp, 0.1_wp, 0.9_wp, 1.0_wp, 1.04_wp, 1.06_wp, 1.6_wp, 5.0_wp, 40.0_wp])
    period = 10.0_wp**uniform(0.3_wp, 3.0_wp)/max(1.0_wp, 2*xi)
    if (harmonic) then
      scene = series_scene(random_series(1 + int(uniform(0.0_wp, 3.0_wp))), period, xi, 0.0_wp, 0)
    else
      call random_table(1 + int(uniform(0.0_wp, 5.0_wp)), 0.3_wp, knots, coefficients, kinks)
      if (size(kinks) == 1) kinks = .true.
      scene = table_scene(knots, coefficients, kinks, period, xi, 0.0_wp, 0)
    end if
  end subroutine slow_scene

  !> Fastest rate of a scene's motion.
  pure real(wp) function longest_rate(scene)
    type(scene_t), intent(in) :: scene            !! scene
    longest_rate = max(1.0_wp, 2*scene%form%damping%xi)
    select type (flank => scene%flank)
    type is (series_flank_t)
      longest_rate = max(longest_rate, maxval(flank%series%rate))
    end select
  end function longest_rate

  !> Largest size of the response in contact.
  pure real(wp) function amplification(scene)
    type(scene_t), intent(in) :: scene            !! scene
    integer :: i
    amplification = 0
    do i = 1, scene%form%n
      amplification = max(amplification, maxval(abs(scene%form%panel(i)%q_begin)), &
          maxval(abs(scene%form%panel(i)%q_bernstein)))
    end do
  end function amplification

  !> Largest of a table's coefficients from an order on; 0 of another flank.
  pure real(wp) function largest_term(scene, order)
    type(scene_t), intent(in) :: scene            !! scene
    integer, intent(in) :: order                  !! least order
    largest_term = 0
    select type (flank => scene%flank)
    type is (te_table_t)
      largest_term = maxval(abs(flank%coefficient(order:, :)))
    end select
  end function largest_term

  !> Taylor coefficients of g about a time on a table piece.
  pure function quad_flank(scene, piece, t) result(g)
    type(scene_t), intent(in) :: scene            !! scene
    integer, intent(in) :: piece                  !! table piece
    real(qp), intent(in) :: t                     !! time in the cycle
    real(qp) :: g(0:order), c, s, power
    integer :: i, k
    g = 0
    select type (flank => scene%flank)
    type is (te_table_t)
      g(0:max_degree) = flank%coefficient(:, piece)
      do i = 0, max_degree - 1
        do k = max_degree - 1, i, -1
          g(k) = g(k) + (t - flank%knot(piece))*g(k + 1)
        end do
      end do
    type is (series_flank_t)
      g(0) = flank%series%constant
      do i = 1, size(flank%series%rate)
        c = cos(flank%series%rate(i)*t)
        s = sin(flank%series%rate(i)*t)
        power = 1
        do k = 0, order
          ! Derivatives of (cosine, sine): value, rate, -value, -rate, ...
          if (mod(k, 2) == 0) then
            g(k) = g(k) + power*(flank%series%cosine(i)*c + flank%series%sine(i)*s)
          else
            g(k) = g(k) + power*(flank%series%sine(i)*c - flank%series%cosine(i)*s)
          end if
          power = power*flank%series%rate(i)/(k + 1)
          if (mod(k, 2) == 1) power = -power
        end do
      end do
    end select
  end function quad_flank

  !> Move position and velocity relative to a flank by a time that stays on one table piece.
  pure subroutine quad_flow(scene, contact, piece, t, s, x, v)
    type(scene_t), intent(in) :: scene            !! scene
    logical, intent(in) :: contact                !! or in flight
    integer, intent(in) :: piece                  !! table piece
    real(qp), intent(in) :: t, s                  !! time in the cycle, time moved by
    real(qp), intent(inout) :: x, v               !! position and velocity
    real(qp) :: g(0:order), c(0:order), h, at
    integer :: i, k, n
    n = max(1, ceiling(s*longest_rate(scene)/step_span))
    h = s/n
    do i = 0, n - 1
      at = t + i*h
      g = quad_flank(scene, piece, at)
      c(0:1) = [x, v]
      do k = 2, order
        c(k) = -g(k)
        if (k == 2) c(k) = c(k) + 0.5_qp*scene%force
        if (contact) c(k) = c(k) &
            - (2*scene%form%damping%xi*(k - 1)*c(k - 1) + c(k - 2))/(k*(k - 1))
      end do
      x = c(order)
      v = order*c(order)
      do k = order - 1, 1, -1
        x = x*h + c(k)
        v = v*h + k*c(k)
      end do
      x = x*h + c(0)
    end do
  end subroutine quad_flow

  !> x''.
  pure real(qp) function quad_acceleration(scene, contact, piece, t, x, v) result(a)
    type(scene_t), intent(in) :: scene            !! scene
    logical, intent(in) :: contact                !! or in flight
    integer, intent(in) :: piece                  !! table piece
    real(qp), intent(in) :: t                     !! time in the cycle
    real(qp), intent(in) :: x, v                  !! position and velocity
    real(qp) :: g(0:order)
    g = quad_flank(scene, piece, t)
    a = scene%force - 2*g(2)
    if (contact) a = a - 2*scene%form%damping%xi*v - x
  end function quad_acceleration
end module exact_reference
