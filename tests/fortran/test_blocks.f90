!> Blocks of panels and pieces: their bounds, and that passing by the block changes no end.
program test_blocks
  use assertions, only: tally_t
  use exact_reference, only: seed, uniform, chance, pick, table_scene, series_scene, random_series
  use lapwing_flow_exact_interval_bounds, only: make_blocks, block_at, last_in_block
  use lapwing_codes, only: drive_flank, coast_flank, no_flank
  use lapwing_flow_exact_contact, only: contact_end
  use lapwing_flow_exact_flight, only: end_t, flight_end
  use lapwing_flow_exact_extrema, only: farthest, next_turn
  use lapwing_flank_series, only: harmonic_series_t, harmonic_series, series_at
  use lapwing_kinds, only: wp
  use lapwing_flank, only: locate_piece
  use lapwing_flow_exact_curve, only: scene_t, curve_t, begin_curve, expand_fully
  use lapwing_flow_exact_motion, only: curve_at
  use lapwing_flow_exact_panels, only: free_size, locate_panel
  implicit none

  real(wp), parameter :: two_pi = 2*acos(-1.0_wp)
  real(wp), parameter :: rounding = 1.0e-14_wp   ! of g and q, of size 1 to 10
  integer, parameter :: n_scenes = 60, n_stretches = 60
  type(tally_t) :: tally
  integer :: i

  call seed(20261122)
  call test_few_have_none()
  do i = 1, n_scenes
    call test_scene(many(i))
  end do
  call tally%finish()

contains

  !> A scene of many panels: a table through a smooth function, or a series over a long period.
  function many(i) result(scene)
    integer, intent(in) :: i                 !! number of the scene
    type(scene_t) :: scene
    real(wp), allocatable :: series(:, :)
    integer :: n
    integer :: error
    series = random_series(3)
    if (mod(i, 4) == 0) then
      scene = series_scene(series, two_pi*(12.4_wp + i), 0.1_wp, uniform(-0.3_wp, 1.0_wp))
    else
      n = int(10.0_wp**uniform(1.72_wp, 3.1_wp))
      scene = smooth_table(series, n, two_pi*uniform(1.3_wp, 9.6_wp), &
          pick([0.03_wp, 0.1_wp, 1.0_wp]), uniform(-0.3_wp, 1.0_wp), chance(0.5_wp))
    end if
    if (mod(i, 3) == 0) then
      call make_blocks(scene%form, scene%flank, scene%blocks, error, fan=4)
    else
      call make_blocks(scene%form, scene%flank, scene%blocks, error)
    end if
  end function many

  !> Cubic pieces through values and slopes of a series; with a kink in the middle, if wanted.
  function smooth_table(series, n, period, xi, force, kinked) result(scene)
    real(wp), intent(in) :: series(:, :)     !! order, amplitude, shift
    integer, intent(in) :: n                 !! pieces
    real(wp), intent(in) :: period, xi, force     !! P, damping ratio, F
    logical, intent(in) :: kinked            !! whether there is a kink
    type(scene_t) :: scene
    type(harmonic_series_t) :: g
    real(wp) :: knots(n + 1), c(0:5, n), value(n + 1), slope(n + 1), h, right
    logical :: kinks(n)
    integer :: k
    g = harmonic_series(series, 1.0_wp, two_pi)
    knots = [(real(k, wp)/n, k = 0, n)]
    do k = 1, n + 1
      call series_at(g, knots(k), value(k), slope(k))
    end do
    value(n + 1) = value(1)
    slope(n + 1) = slope(1)
    c = 0
    do k = 1, n
      h = knots(k + 1) - knots(k)
      kinks(k) = kinked .and. k == n/2 + 1
      right = slope(k) + merge(0.5_wp, 0.0_wp, kinks(k))
      c(0:1, k) = [value(k), right]
      c(2, k) = (3*(value(k + 1) - value(k))/h - 2*right - slope(k + 1))/h
      c(3, k) = (right + slope(k + 1) - 2*(value(k + 1) - value(k))/h)/h**2
    end do
    scene = table_scene(knots, c, kinks, period, xi, force)
  end function smooth_table

  !> A scene of few panels is left alone.
  subroutine test_few_have_none()
    type(scene_t) :: scene
    integer :: error
    scene = series_scene(random_series(1), two_pi, 0.1_wp, 1.0_wp)
    call make_blocks(scene%form, scene%flank, scene%blocks, error)
    call tally%is_true(scene%blocks%panels%levels == 0 .and. scene%blocks%pieces%levels == 0, &
        "no blocks")
  end subroutine test_few_have_none

  subroutine test_scene(scene)
    type(scene_t), intent(in) :: scene       !! scene with blocks
    integer :: k
    call tally%is_true(scene%blocks%panels%size(1) > 1, "there are blocks")
    call check_bounds(scene)
    do k = 1, n_stretches
      call compare_flights(scene)
      call compare_contacts(scene)
    end do
  end subroutine test_scene

  !> g, the response and the free oscillation lie within the bounds of their block.
  subroutine check_bounds(scene)
    type(scene_t), intent(in) :: scene       !! scene with blocks
    real(wp) :: t, g(0:5), free(2), step(2)
    integer :: panel, piece, k, next, level
    logical :: inside
    inside = .true.
    do panel = 1, scene%form%n
      do k = 0, 10
        t = scene%form%edge(panel) &
            + 0.0999_wp*k*(scene%form%edge(panel + 1) - scene%form%edge(panel))
        piece = scene%form%piece(panel)
        call scene%flank%taylor(piece, t, g)
        do level = 1, scene%blocks%panels%levels
          associate (block => scene%blocks%over(block_at(scene%blocks%panels, level, panel)))
            inside = inside .and. g(0) >= block%g_low - rounding &
                .and. g(0) <= block%g_high + rounding
            inside = inside .and. scene%form%panel(panel)%q_begin(1) >= block%q_low - rounding &
                .and. scene%form%panel(panel)%q_begin(1) <= block%q_high + rounding
          end associate
        end do
        do level = 1, scene%blocks%pieces%levels
          next = block_at(scene%blocks%pieces, level, piece)
          inside = inside .and. g(0) >= scene%blocks%g_low(next) - rounding &
              .and. g(0) <= scene%blocks%g_high(next) + rounding
        end do
      end do
    end do
    call tally%is_true(inside, "bounds of blocks hold")
    do level = 1, scene%blocks%panels%levels
      do panel = 1, scene%form%n - scene%blocks%panels%size(level), scene%blocks%panels%size(level)
        free = [0.3_wp, -0.7_wp]
        step = matmul(scene%blocks%over(block_at(scene%blocks%panels, level, panel))%d_matrix, free)
        do next = panel, last_in_block(scene%blocks%panels, level, panel)
          free = matmul(scene%form%panel(next)%d_matrix, free)
        end do
        call tally%below(free_size(step - free), 1.0e-13_wp, &
            "a block's free oscillation is its panels'")
      end do
    end do
  end subroutine check_bounds

  !> Begin an arc anywhere in the period; until the next kink or the period's end.
  subroutine begin(scene, contact, x, v, curve, stop)
    type(scene_t), intent(in) :: scene       !! scene
    logical, intent(in) :: contact           !! which of the two
    real(wp), intent(in) :: x, v             !! position and velocity
    type(curve_t), intent(out) :: curve      !! arc
    real(wp), intent(out) :: stop            !! latest end
    real(wp) :: t
    integer :: piece
    t = uniform(0.0_wp, scene%form%period)*pick([0.0_wp, 0.1_wp, 1.0_wp])
    piece = locate_piece(scene%flank, t, 1)
    call begin_curve(scene, contact, t, piece, x, v, curve)
    call expand_fully(scene, curve)
    stop = scene%flank%knot(scene%flank%next_kink(piece)) - t
    if (chance(0.3_wp)) stop = stop*uniform(0.0_wp, 1.0_wp)
  end subroutine begin

  subroutine compare_flights(scene)
    type(scene_t), intent(in) :: scene       !! scene with blocks
    type(scene_t) :: plain
    type(curve_t) :: curve, again
    type(end_t) :: at, other
    real(wp) :: stop, wall(2)
    wall = [0.0_wp, -pick([0.3_wp, 2.0_wp, 20.0_wp])]
    call begin(scene, .false., uniform(wall(2), 0.0_wp), uniform(-2.0_wp, 2.0_wp), curve, stop)
    again = curve
    plain = scene
    plain%blocks%panels%levels = 0
    plain%blocks%pieces%levels = 0
    call flight_end(scene, curve, wall, no_flank, stop, at)
    call flight_end(plain, again, wall, no_flank, stop, other)
    call compare(at, other, "flight")
    call check_farthest(scene, curve, at%s)
    call tally%near(farthest(scene, curve, -1.0_wp, at%s, 0.1_wp), &
        farthest(plain, curve, -1.0_wp, at%s, 0.1_wp), 1.0e-11_wp, "deepest point of a flight")
    call compare_turns(scene, plain, curve, at%s)
  end subroutine compare_flights

  !> The farthest point against samples: beyond none of them, nor farther than the motion bends
  !> between two.
  subroutine check_farthest(scene, curve, until)
    type(scene_t), intent(in) :: scene       !! scene
    type(curve_t), intent(in) :: curve       !! flight
    real(wp), intent(in) :: until            !! its end
    integer, parameter :: n = 300
    real(wp) :: x(0:n), v, s, sign, most, bend
    integer :: i
    do i = 0, n
      s = i*until/n
      call curve_at(scene, curve, locate_panel(scene%form, curve%t + s), s, x(i), v)
    end do
    sign = pick([-1.0_wp, 1.0_wp])
    most = farthest(scene, curve, sign, until, -huge(s))
    bend = maxval(abs(x(2:) - 2*x(1:n - 1) + x(:n - 2)))
    call tally%below(maxval(sign*x), most + 1.0e-12_wp*(1 + abs(most)), "nothing is farther")
    call tally%below(most, maxval(sign*x) + bend + 1.0e-12_wp*(1 + abs(most)), "nor is it")
  end subroutine check_farthest

  subroutine compare_contacts(scene)
    type(scene_t), intent(in) :: scene       !! scene with blocks
    type(scene_t) :: plain
    type(curve_t) :: curve, again
    type(end_t) :: at, other
    real(wp) :: stop, inward
    integer :: flank
    flank = merge(drive_flank, coast_flank, chance(0.6_wp))
    inward = merge(1.0_wp, -1.0_wp, flank == drive_flank)
    call begin(scene, .true., inward*uniform(0.0_wp, 1.5_wp), uniform(-1.0_wp, 1.0_wp), curve, stop)
    again = curve
    plain = scene
    plain%blocks%panels%levels = 0
    call contact_end(scene, curve, flank, .false., stop, at)
    call contact_end(plain, again, flank, .false., stop, other)
    call compare(at, other, "contact")
    call tally%near(farthest(scene, curve, -1.0_wp, at%s, 0.1_wp), &
        farthest(plain, curve, -1.0_wp, at%s, 0.1_wp), 1.0e-11_wp, "deepest point of a contact")
    call compare_turns(scene, plain, curve, at%s)
  end subroutine compare_contacts

  !> Turns that are near enough are the same with and without blocks.
  subroutine compare_turns(scene, plain, curve, until)
    type(scene_t), intent(in) :: scene, plain    !! with and without blocks
    type(curve_t), intent(in) :: curve           !! arc
    real(wp), intent(in) :: until                !! its end
    real(wp) :: within, sign, s, other
    logical :: found, again
    sign = pick([-1.0_wp, 1.0_wp])
    within = uniform(-1.0_wp, 1.0_wp)
    s = 0
    other = 0
    do
      call near_turn(scene, curve, sign, within, until, found, s)
      call near_turn(plain, curve, sign, within, until, again, other)
      call tally%is_true(found .eqv. again, "as many near turns")
      if (.not. (found .and. again)) return
      call tally%near(s, other, 1.0e-7_wp, "near turns at the same times")
    end do
  end subroutine compare_turns

  !> The next turn with sign*x below a limit.
  subroutine near_turn(scene, curve, sign, within, until, found, s)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve           !! arc
    real(wp), intent(in) :: sign, within         !! the limit
    real(wp), intent(in) :: until                !! end of the arc
    logical, intent(out) :: found
    real(wp), intent(inout) :: s                 !! after which time; when
    real(wp) :: x, v, from
    do
      from = s
      call next_turn(scene, curve, sign, within, from, until, found, s)
      if (.not. found) return
      call curve_at(scene, curve, locate_panel(scene%form, curve%t + s), s, x, v)
      if (sign*x <= within) return
    end do
  end subroutine near_turn

  !> Two ways to the same end. Rounding: some hundred pieces walked, crossings at a slant.
  subroutine compare(at, other, what)
    type(end_t), intent(in) :: at, other     !! ends
    character(*), intent(in) :: what         !! what ends
    call tally%equal(at%flank, other%flank, what//": the same flank")
    call tally%near(at%s, other%s, 1.0e-8_wp, what//": the same time")
    call tally%near(at%x, other%x, 1.0e-11_wp, what//": the same position")
    call tally%near(at%v, other%v, 1.0e-8_wp, what//": the same velocity")
  end subroutine compare
end program test_blocks
