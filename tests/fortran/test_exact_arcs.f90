!> How arcs in closed form end, against the differential equation followed in quadruple
!> precision with dense samples: flights between two flanks, contacts, and what lies at their stop.
program test_exact_arcs
  use assertions, only: tally_t
  use exact_reference, only: qp, seed, uniform, chance, pick, random_scene, slow_scene, &
      table_scene, series_scene, quad_flow, amplification, largest_term, &
      scene_at_rest
  use lapwing_codes, only: no_flank, drive_flank, coast_flank
  use lapwing_flow_exact_contact, only: contact_end
  use lapwing_flow_exact_flight, only: end_t, flight_end, bounce, least_width
  use lapwing_flow_exact_extrema, only: farthest, next_turn
  use lapwing_kinds, only: wp
  use lapwing_flow_exact_curve, only: scene_t, curve_t, begin_curve, expand_start, expand_fully, &
      expand_over, is_smooth
  use lapwing_flank, only: locate_piece
  implicit none

  type(tally_t) :: tally
  real(wp), parameter :: eps = epsilon(1.0_wp)
  integer, parameter :: n_arcs = 1000, n_slow = 400, n_samples = 150

  call seed(20261126)
  call test_flights()
  call test_contacts()
  call test_slow_contacts()
  call test_kink_is_a_stop()
  call test_crossing_at_the_stop()
  call test_mirror()
  call test_bounce()
  call tally%finish()

contains

  !> Rounding of a position after s.
  real(wp) function rounding(scene, curve, s)
    type(scene_t), intent(in) :: scene       !! scene
    type(curve_t), intent(in) :: curve       !! arc
    real(wp), intent(in) :: s                !! time
    real(wp) :: bend
    if (scene%form%graded) then
      ! Of its terms, and of time against the period at the speed of each.
      rounding = eps*(50 + 2*scene%form%period) &
          *(abs(curve%x) + abs(curve%v) + abs(scene%force) + amplification(scene))
      return
    end if
    bend = 1 + largest_term(scene, 2)
    rounding = eps*(40*(abs(curve%x) + abs(curve%v) + 5)*(1 + s)**2 &
        + (200 + 10*scene%form%n)*(bend + amplification(scene)))
  end function rounding

  !> By the equation to time s of the arc, from a state at a time of it, before any kink there.
  subroutine follow(scene, curve, piece, at, s, x, v)
    type(scene_t), intent(in) :: scene       !! scene
    type(curve_t), intent(in) :: curve       !! arc
    integer, intent(inout) :: piece          !! table piece
    real(qp), intent(inout) :: at            !! time since it began, moved to s
    real(qp), intent(in) :: s                !! later time
    real(qp), intent(inout) :: x, v          !! position and velocity
    real(qp) :: begin, finish
    do
      begin = curve%t + at
      finish = curve%t + s
      if (piece < scene%flank%n) finish = min(finish, real(scene%flank%knot(piece + 1), qp))
      call quad_flow(scene, curve%contact, piece, begin, &
          max(finish - begin, 0.0_qp), x, v)
      at = finish - curve%t
      if (finish >= curve%t + s) exit
      piece = piece + 1
    end do
    at = s
  end subroutine follow

  !> Walls that the motion, sampled up to the end found, does not pass by more than rounding; and
  !> position and velocity at that end.
  subroutine check_end(scene, curve, wall, stop, at, what)
    type(scene_t), intent(in) :: scene       !! scene
    type(curve_t), intent(in) :: curve       !! arc
    real(wp), intent(in) :: wall(2)          !! upper and lower wall
    real(wp), intent(in) :: stop             !! latest end
    type(end_t), intent(in) :: at            !! end found
    character(*), intent(in) :: what         !! in words
    real(qp) :: x, v, time
    real(wp) :: allowed, highest, lowest
    integer :: i, piece
    call tally%is_true(0 <= at%s .and. at%s <= stop, what//": ends in time")
    if (at%flank == no_flank) call tally%is_true(at%s == stop, what//": lasts until its stop")
    allowed = rounding(scene, curve, at%s)
    x = curve%x
    v = curve%v
    time = 0
    piece = curve%piece
    highest = wall(2)
    lowest = wall(1)
    do i = 1, n_samples
      call follow(scene, curve, piece, time, (at%s*real(i, qp))/n_samples, x, v)
      highest = max(highest, real(x, wp))
      lowest = min(lowest, real(x, wp))
    end do
    call tally%below(highest - wall(1), allowed, what//": upper wall passed")
    call tally%below(wall(2) - lowest, allowed, what//": lower wall passed")
    call tally%near(at%x, real(x, wp), allowed, what//": position at its end")
    call tally%near(at%v, real(v, wp), allowed, what//": velocity at its end")
    if (at%flank == no_flank) return
    call tally%near(real(x, wp), wall(at%flank), allowed + 2*spacing(curve%t + at%s)*abs(at%v), &
        what//": at the wall")
    call tally%below(merge(-at%v, at%v, at%flank == drive_flank), allowed, what//": on its way in")
  end subroutine check_end

  !> Where the arc must end at the latest: the next kink or the end of the cycle.
  real(wp) function longest(scene, curve)
    type(scene_t), intent(in) :: scene       !! scene
    type(curve_t), intent(in) :: curve       !! arc
    longest = scene%flank%knot(scene%flank%next_kink(curve%piece)) - curve%t
  end function longest

  !> Begin in flight or contact.
  subroutine begin(scene, contact, x, v, curve)
    type(scene_t), intent(inout) :: scene    !! scene, sometimes then seen from a flank that stands
    logical, intent(in) :: contact           !! which of the two
    real(wp), intent(in) :: x, v             !! position and velocity
    type(curve_t), intent(out) :: curve      !! arc
    real(wp) :: t
    integer :: piece
    t = uniform(0.0_wp, scene%form%period)
    piece = locate_piece(scene%flank, t, 1)
    if (chance(0.2_wp)) t = scene%flank%knot(piece)
    if (.not. chance(0.9_wp)) then
      scene = scene_at_rest(scene)
      piece = 1
    end if
    call begin_curve(scene, contact, t, piece, x, v, curve)
  end subroutine begin

  subroutine test_flights()
    type(scene_t) :: scene
    type(curve_t) :: curve
    type(end_t) :: at
    real(wp) :: wall(2), stop, x, v
    integer :: i, touching, met(0:2)
    met = 0
    do i = 1, n_arcs
      call random_scene(mod(i, 3) == 0, pick([0.0_wp, 0.3_wp]), scene)
      wall = [0.0_wp, -10.0_wp**uniform(-3.0_wp, 0.7_wp)]
      if (chance(0.2_wp)) wall(2) = least_width
      touching = int(pick([0.0_wp, 0.0_wp, 1.0_wp, 2.0_wp]))
      if (wall(2) == least_width .and. touching == coast_flank) touching = no_flank
      x = max(wall(2), -3.0_wp)*uniform(0.05_wp, 0.95_wp)
      v = uniform(-1.5_wp, 1.5_wp)
      if (touching /= no_flank) then
        x = wall(touching)
        v = merge(-1, 1, touching == drive_flank)*10.0_wp**uniform(-9.0_wp, 0.3_wp)
      end if
      call begin(scene, .false., x, v, curve)
      stop = longest(scene, curve)
      if (chance(0.3_wp)) stop = stop*uniform(0.0_wp, 1.0_wp)
      call flight_end(scene, curve, wall, touching, stop, at)
      met(at%flank) = met(at%flank) + 1
      call check_end(scene, curve, [wall(1), max(wall(2), -1.0e6_wp)], stop, at, "flight")
      call expand_over(scene, curve, at%s)
      call check_turns(scene, curve, at%s, "a flight")
      if (touching /= no_flank) call tally%is_true(at%s > 0, "a flank left is not met at once")
    end do
    print "(a, 3(1x, i0))", "measured: flights to their stop, drive and coast flank", met
    call tally%below(60.0_wp, real(minval(met), wp), "each end of a flight seen")
  end subroutine test_flights

  subroutine test_contacts()
    type(scene_t) :: scene
    type(curve_t) :: curve, again
    type(end_t) :: at
    real(wp) :: wall(2), stop, x, v, sign
    integer :: i, flank, met(0:2)
    logical :: touching
    met = 0
    do i = 1, n_arcs
      call random_scene(mod(i, 3) == 0, pick([0.0_wp, 0.3_wp]), scene)
      flank = merge(drive_flank, coast_flank, chance(0.5_wp))
      sign = merge(1.0_wp, -1.0_wp, flank == drive_flank)
      if (chance(0.5_wp)) scene%force = sign*abs(scene%force)
      ! The force under which the response alone would just touch, and a little more.
      if (chance(0.2_wp)) scene%force = merge(-scene%form%q_low, -scene%form%q_high, sign > 0) &
          *(1 + 10.0_wp**uniform(-9.0_wp, 0.0_wp))
      touching = chance(0.4_wp)
      x = sign*10.0_wp**uniform(-6.0_wp, 0.3_wp)
      v = uniform(-1.5_wp, 1.5_wp)
      if (touching) then
        x = 0
        v = sign*10.0_wp**uniform(-9.0_wp, 0.3_wp)
      end if
      call begin(scene, .true., x, v, curve)
      stop = longest(scene, curve)
      if (chance(0.3_wp)) stop = stop*uniform(0.0_wp, 1.0_wp)
      ! It may begin the arc anew at a knot.
      again = curve
      call contact_end(scene, again, flank, touching, stop, at)
      met(at%flank) = met(at%flank) + 1
      ! Release is met from inside: a wall at zero on the other side of the motion.
      wall = [1.0e6_wp, 0.0_wp]
      if (flank == coast_flank) wall = [0.0_wp, -1.0e6_wp]
      if (at%flank /= no_flank) then
        call tally%equal(at%flank, flank, "the flank released")
        at%flank = 3 - flank
      end if
      call check_end(scene, curve, wall, stop, at, "contact")
      if (touching) call tally%is_true(at%s > 0, "a flank gone into is not left at once")
    end do
    print "(a, 3(1x, i0))", "measured: contacts to their stop, off drive and coast flank", met
    call tally%below(60.0_wp, real(minval(met), wp), "each end of a contact seen")
  end subroutine test_contacts

  !> Contacts in graded scenes: near release, near rest or thrown about, and up to the next knot.
  subroutine test_slow_contacts()
    type(scene_t) :: scene
    type(curve_t) :: curve, again
    type(end_t) :: at
    real(wp) :: wall(2), stop, x, v, sign, size
    integer :: i, flank, met(0:2)
    logical :: touching
    met = 0
    do i = 1, n_slow
      call slow_scene(mod(i, 3) == 0, scene)
      call tally%is_true(scene%form%graded, "a graded scene")
      flank = merge(drive_flank, coast_flank, chance(0.5_wp))
      sign = merge(1.0_wp, -1.0_wp, flank == drive_flank)
      size = amplification(scene)
      scene%force = sign*size*pick([0.2_wp, 0.8_wp, 1.5_wp])
      touching = chance(0.3_wp)
      x = sign*size*10.0_wp**uniform(-3.0_wp, 0.3_wp)
      v = size*uniform(-1.5_wp, 1.5_wp)*pick([0.0_wp, 1.0_wp, 2*scene%form%damping%xi])
      if (touching) then
        x = 0
        v = sign*size*10.0_wp**uniform(-9.0_wp, 0.3_wp)
      end if
      call begin(scene, .true., x, v, curve)
      stop = min(longest(scene, curve), scene%flank%knot(curve%piece + 1) - curve%t)
      if (chance(0.3_wp)) stop = stop*uniform(0.0_wp, 1.0_wp)
      again = curve
      call contact_end(scene, again, flank, touching, stop, at)
      met(at%flank) = met(at%flank) + 1
      wall = [1.0e6_wp, 0.0_wp]
      if (flank == coast_flank) wall = [0.0_wp, -1.0e6_wp]
      if (at%flank /= no_flank) then
        call tally%equal(at%flank, flank, "the flank released, slowly")
        at%flank = 3 - flank
      end if
      call check_end(scene, curve, wall, stop, at, "slow contact")
      call expand_fully(scene, curve)
      call check_turns(scene, curve, at%s, "a slow contact")
    end do
    print "(a, 3(1x, i0))", "measured: slow contacts to their stop, off either flank", met
    call tally%below(20.0_wp, real(minval(met), wp), "each end of a slow contact seen")
  end subroutine test_slow_contacts

  !> The farthest points, both ways, are those of the ends and of all turns.
  subroutine check_turns(scene, curve, until, what)
    type(scene_t), intent(in) :: scene       !! scene
    type(curve_t), intent(in) :: curve       !! arc, its series known
    real(wp), intent(in) :: until            !! its length
    character(*), intent(in) :: what         !! kind of arc
    real(qp) :: x, v, time
    real(wp) :: from, s, high, low, allowed
    integer :: piece, n
    logical :: found
    allowed = rounding(scene, curve, until)
    x = curve%x
    v = curve%v
    time = 0
    piece = curve%piece
    high = curve%x
    low = curve%x
    from = 0
    n = 0
    do
      call next_turn(scene, curve, 1.0_wp, huge(s), from, until, found, s)
      if (.not. found) exit
      n = n + 1
      if (n > 200) return
      call follow(scene, curve, piece, time, real(s, qp), x, v)
      high = max(high, real(x, wp))
      low = min(low, real(x, wp))
      call tally%near(real(v, wp), 0.0_wp, allowed*max(1.0_wp, 2*scene%form%damping%xi), &
          what//": velocity at a turn")
      from = s
    end do
    call follow(scene, curve, piece, time, real(until, qp), x, v)
    high = max(high, real(x, wp))
    low = min(low, real(x, wp))
    call tally%near(farthest(scene, curve, 1.0_wp, until, -huge(until)), high, allowed, &
        what//": largest x")
    call tally%near(-farthest(scene, curve, -1.0_wp, until, -huge(until)), low, allowed, &
        what//": smallest x")
  end subroutine check_turns

  !> One kink in mid-period: velocity at the stop is that before it, though the flank turns there.
  subroutine test_kink_is_a_stop()
    real(wp) :: coefficients(0:5, 2), stop
    type(scene_t) :: scene
    type(curve_t) :: curve, again
    type(end_t) :: at
    ! g rises to 1 at 0.3 and falls again, over P = 2; F = 0.
    coefficients = 0
    coefficients(1, 1) = 1/0.3_wp
    coefficients(0, 2) = 1
    coefficients(1, 2) = -1/0.7_wp
    scene = table_scene([0.0_wp, 0.3_wp, 1.0_wp], coefficients, [.true., .true.], 2.0_wp, 0.1_wp, &
        0.0_wp)
    call begin_curve(scene, .false., 0.1_wp, 1, -0.5_wp, 0.2_wp, curve)
    stop = scene%flank%knot(2) - 0.1_wp
    call flight_end(scene, curve, [0.0_wp, -9.0_wp], no_flank, stop, at)
    call tally%equal(at%flank, no_flank, "flight up to a kink")
    call tally%near(at%s, stop, 0.0_wp, "its duration")
    call tally%near(at%x, -0.5_wp + 0.2_wp*stop, 4*eps, "its position there")
    call tally%near(at%v, 0.2_wp, 4*eps, "its velocity before the kink")
    call begin_curve(scene, .true., 0.1_wp, 1, 5.0_wp, 0.0_wp, curve)
    again = curve
    call contact_end(scene, again, drive_flank, .false., stop, at)
    call tally%equal(at%flank, no_flank, "contact up to a kink")
    call check_end(scene, curve, [1.0e6_wp, 0.0_wp], stop, at, "contact up to a kink")
  end subroutine test_kink_is_a_stop

  !> A crossing exactly at the stop is one there or none; 1e-9 before it is one, behind it none.
  subroutine test_crossing_at_the_stop()
    real(wp) :: coefficients(0:5, 1), speed, stop
    type(scene_t) :: scene
    type(curve_t) :: curve
    type(end_t) :: at
    integer :: i, k
    coefficients = 0
    do i = 1, 200
      scene = table_scene([0.0_wp, 1.0_wp], coefficients, [.false.], 8.0_wp, 0.1_wp, 0.0_wp)
      if (mod(i, 2) == 0) scene = series_scene(reshape([1.0_wp, 0.0_wp, 0.0_wp], [3, 1]), 8.0_wp, &
          0.1_wp, 0.0_wp)
      speed = uniform(0.2_wp, 3.0_wp)
      stop = uniform(0.1_wp, 2.0_wp)
      do k = -1, 1
        call begin_curve(scene, .false., 0.25_wp, 1, -speed*stop, speed, curve)
        call flight_end(scene, curve, [0.0_wp, -1.0e3_wp], no_flank, stop*(1 + k*1.0e-9_wp), at)
        if (k /= 0) call tally%equal(at%flank, merge(drive_flank, no_flank, k == 1), &
            "a wall near the stop")
        call tally%near(at%s, merge(stop, stop*(1 + k*1.0e-9_wp), k == 1), 4*eps*stop, &
            "end near a wall")
      end do
    end do
  end subroutine test_crossing_at_the_stop

  !> The drive flank's world turned upside down is the coast flank's. The drive flank is looked at
  !> first; what is found at the other one is then polished from elsewhere, to a few bits the same.
  subroutine test_mirror()
    type(scene_t) :: scene, mirrored
    type(curve_t) :: curve
    type(end_t) :: at, other
    real(wp) :: series(3, 2), force, t, x, v, wall
    integer :: i
    do i = 1, 300
      series(:, 1) = [1.0_wp, uniform(-0.5_wp, 0.5_wp), uniform(0.0_wp, 6.0_wp)]
      series(:, 2) = [2.0_wp, uniform(-0.2_wp, 0.2_wp), uniform(0.0_wp, 6.0_wp)]
      force = uniform(-1.0_wp, 2.0_wp)
      scene = series_scene(series, 9.1_wp, 0.1_wp, force)
      series(2, :) = -series(2, :)
      mirrored = series_scene(series, 9.1_wp, 0.1_wp, -force)
      t = uniform(0.0_wp, 9.0_wp)
      wall = uniform(0.1_wp, 2.0_wp)
      x = -wall*uniform(0.1_wp, 0.9_wp)
      v = uniform(-1.0_wp, 1.0_wp)
      call begin_curve(scene, .false., t, 1, x, v, curve)
      call flight_end(scene, curve, [0.0_wp, -wall], no_flank, 9.1_wp - t, at)
      call begin_curve(mirrored, .false., t, 1, -x, -v, curve)
      call flight_end(mirrored, curve, [wall, 0.0_wp], no_flank, 9.1_wp - t, other)
      call tally%equal(other%flank, merge(0, 3 - at%flank, at%flank == 0), "flight, mirrored")
      call check_mirrored(at, other)
      call begin_curve(scene, .true., t, 1, -x, v, curve)
      call contact_end(scene, curve, drive_flank, .false., 9.1_wp - t, at)
      call begin_curve(mirrored, .true., t, 1, x, -v, curve)
      call contact_end(mirrored, curve, coast_flank, .false., 9.1_wp - t, other)
      call tally%equal(other%flank, merge(0, 3 - at%flank, at%flank == 0), "contact, mirrored")
      call check_mirrored(at, other)
    end do
  end subroutine test_mirror

  subroutine check_mirrored(at, other)
    type(end_t), intent(in) :: at, other     !! end, end of the mirrored arc
    call tally%near(other%s, at%s, 1.0e-13_wp, "its end, mirrored")
    call tally%near(other%x, -at%x, 1.0e-13_wp, "position there, mirrored")
    call tally%near(other%v, -at%v, 1.0e-13_wp, "velocity there, mirrored")
  end subroutine check_mirrored

  !> The speed of a short bounce's return, without cancellation: relative to the speed itself.
  subroutine test_bounce()
    type(scene_t) :: scene
    type(curve_t) :: curve
    type(end_t) :: at
    real(qp) :: x, v
    real(wp) :: speed, t, pull
    integer :: i, touching, hits, piece
    logical :: found
    hits = 0
    do i = 1, n_arcs
      call random_scene(mod(i, 2) == 0, 0.0_wp, scene)
      t = uniform(0.0_wp, 0.95_wp)*scene%form%period
      piece = locate_piece(scene%flank, t, 1)
      touching = merge(drive_flank, coast_flank, chance(0.5_wp))
      speed = 10.0_wp**uniform(-14.0_wp, -2.0_wp)
      call begin_curve(scene, .false., t, piece, 0.0_wp, merge(-speed, speed, &
          touching == drive_flank), curve)
      call expand_start(scene, curve)
      call bounce(curve, merge([0.0_wp, -1.0_wp], [1.0_wp, 0.0_wp], touching == drive_flank), &
          touching, scene%flank%knot(piece + 1) - t, found, at)
      if (.not. found) cycle
      hits = hits + 1
      call tally%equal(at%flank, touching, "back at the flank it left")
      x = 0
      v = curve%v
      call quad_flow(scene, .false., piece, real(t, qp), real(at%s, qp), x, v)
      ! t - knot rounds by EPS P, the pull by that times its rate: relative to the pull itself.
      pull = abs(2*curve%taylor(2))
      call tally%near(at%v, real(v, wp), speed*eps*(16 + 16*size_of_pull(scene)/pull), &
          "speed of return")
      call tally%near(real(x, wp), 0.0_wp, speed*at%s*eps*(16 + 16*size_of_pull(scene)/pull), &
          "position of return")
    end do
    call tally%below(0.2_wp*n_arcs, real(hits, wp), "bounces")
  end subroutine test_bounce

  !> Sizes of what a pull is the sum of.
  real(wp) function size_of_pull(scene)
    type(scene_t), intent(in) :: scene       !! scene
    size_of_pull = abs(scene%force) + 40
    if (.not. is_smooth(scene%flank)) size_of_pull = abs(scene%force) &
        + largest_term(scene, 2)*20*(1 + scene%form%period)**4
  end function size_of_pull
end program test_exact_arcs
