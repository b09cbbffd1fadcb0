!> Events inside one step: which, when, and how exactly.
program test_event_search
  use assertions, only: tally_t
  use lapwing_codes, only: separation, engagement, no_flank, drive_flank, coast_flank
  use lapwing_flow, only: work_t
  use lapwing_flow_rk4_crossing, only: crossing_t, find_crossing, polish_crossing
  use lapwing_kinds, only: wp
  use lapwing_system_oscillator, only: oscillator_t
  use test_systems, only: oscillator
  use lapwing_system_parameters, only: parameters_t
  use lapwing_polynomial_evaluation, only: horner
  use lapwing_polynomial_roots, only: first_descent
  use lapwing_flow_rk4_step, only: rk4_step
  use lapwing_system_start, only: start_from
  use lapwing_system, only: instant_t, frame_t, motion_t, max_states
  use test_systems, only: ball_t, forced_mass_t
  implicit none

  !> As in test_polynomial: 2*degree units of the sizes involved, four times.
  real(wp), parameter :: rounding = 40*epsilon(1.0_wp)
  !> A quarter, so that scaling from sigma to s is exact.
  real(wp), parameter :: h = 0.25_wp
  type(tally_t) :: tally

  call test_both_flanks()
  call test_several_crossings()
  call test_crossing_and_touching()
  call test_rearm()
  call test_first_descent()
  call test_release()
  call test_one_flank()
  call test_pieces()
  call test_polish()
  call tally%finish()

contains

  !> Search the path x(sigma) of a ball between walls at 0 and -1.
  subroutine search(x, motion_state, touching, crossing, n_flanks)
    real(wp), intent(in) :: x(0:4)                  !! path, powers of s/h
    integer, intent(in) :: motion_state, touching   !! see find_crossing
    type(crossing_t), intent(out) :: crossing       !! what was found
    integer, intent(in), optional :: n_flanks       !! 1: no coast flank
    type(ball_t) :: ball
    type(instant_t) :: instant
    type(frame_t) :: frame
    type(motion_t) :: motion
    type(work_t) :: work
    real(wp) :: z(max_states)
    ball%wall = [0.0_wp, -1.0_wp]
    ball%period = 10
    if (present(n_flanks)) ball%n_flanks = n_flanks
    instant%motion_state = motion_state
    call ball%open_frame(instant, frame)
    z = instant%y
    motion%h = h
    motion%dense(0:4, 1) = x
    call find_crossing(ball, frame, motion_state, touching, motion, work, crossing)
    call tally%is_true(work%drive_searches <= 1 .and. work%coast_searches <= 1, "one search each")
    if (ball%n_flanks == 1) call tally%near(work%coast_searches, 0.0_wp, 0.0_wp, "no coast search")
  end subroutine search

  subroutine expect(crossing, flank, sigma, tolerance, what)
    type(crossing_t), intent(in) :: crossing      !! what was found
    integer, intent(in) :: flank                  !! expected flank
    real(wp), intent(in) :: sigma                 !! expected s/h
    real(wp), intent(in) :: tolerance             !! of it
    character(*), intent(in) :: what              !! in words
    call tally%is_true(crossing%found, what//": found")
    if (.not. crossing%found) return
    call tally%equal(crossing%flank, flank, what//": flank")
    call tally%near(crossing%s/h, sigma, tolerance, what)
  end subroutine expect

  !> Path -1/2 -+ 4 (sigma - 2 sigma**3): reaches the one flank and then the other in one step. The
  !> first root of 8 sigma**3 - 4 sigma + 1/2 comes from Newton, whose limit is good to rounding.
  subroutine test_both_flanks()
    real(wp), parameter :: x(0:4) = [0.0_wp, -4.0_wp, 0.0_wp, 8.0_wp, 0.0_wp]
    type(crossing_t) :: crossing
    real(wp) :: sigma
    integer :: i
    sigma = 0.125_wp
    do i = 1, 40
      sigma = sigma - (8*sigma**3 - 4*sigma + 0.5_wp)/(24*sigma**2 - 4)
    end do
    call search(x + [-0.5_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp], separation, no_flank, crossing)
    call expect(crossing, coast_flank, sigma, 2*rounding, "coast flank, then drive flank")
    call search(-x - [0.5_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp], separation, no_flank, crossing)
    call expect(crossing, drive_flank, sigma, 2*rounding, "drive flank, then coast flank")
    ! From one flank to the other and back: sigma (1 - sigma) reaches 1 at (1 - sqrt(0.6))/2.
    call search([0.0_wp, -10.0_wp, 10.0_wp, 0.0_wp, 0.0_wp], separation, drive_flank, crossing)
    call expect(crossing, coast_flank, 0.5_wp*(1 - sqrt(0.6_wp)), 2*rounding, "from flank to flank")
  end subroutine test_both_flanks

  !> Path -(sigma - 0.2)(sigma - 0.4)(sigma - 0.6)(sigma - 0.8): four crossings, the first counts.
  !> Rounding over slope: sizes at 0.2 (0.4*0.6*0.8*1)/(0.2*0.4*0.6) = 4.
  subroutine test_several_crossings()
    type(crossing_t) :: crossing
    call search([-0.0384_wp, 0.4_wp, -1.4_wp, 2.0_wp, -1.0_wp], separation, no_flank, crossing)
    call expect(crossing, drive_flank, 0.2_wp, 4*rounding, "first of four crossings")
    call search([0.0_wp, -0.096_wp, 0.44_wp, -0.6_wp, 0.24_wp], separation, drive_flank, crossing)
    call tally%is_true(crossing%found, "first of crossings after a start at the flank")
  end subroutine test_several_crossings

  !> Path -(sigma - 0.3)**2 (0.7 - sigma) + shift: a graze missed by 1e-6 is passed over, one beyond
  !> by 1e-6 is met, 1e-6/0.4 under the root before 0.3.
  subroutine test_crossing_and_touching()
    real(wp), parameter :: x(0:4) = [-0.063_wp, 0.51_wp, -1.3_wp, 1.0_wp, 0.0_wp]
    real(wp), parameter :: shift(0:4) = [1.0e-6_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp]
    type(crossing_t) :: crossing
    call search(x - shift, separation, no_flank, crossing)
    ! The crossing at 0.7 has slope 0.16 and moves by shift/slope, with curvature 4e-11.
    call expect(crossing, drive_flank, 0.7_wp + 1.0e-6_wp/0.16_wp, 1.0e-9_wp, "after a near graze")
    call search(x + shift, separation, no_flank, crossing)
    call expect(crossing, drive_flank, 0.3_wp - sqrt(1.0e-6_wp/0.4_wp), 1.0e-5_wp, &
        "a shallow graze")
    call search(x, separation, no_flank, crossing)
    call tally%is_true(crossing%found, "an exact graze and a crossing")
    call tally%below(min(abs(crossing%s/h - 0.3_wp), abs(crossing%s/h - 0.7_wp)), 1.0e-7_wp, &
        "an exact graze or the crossing after it, nothing else")
  end subroutine test_crossing_and_touching

  !> A bounce of any size, down to 1e-15 of the step, ends to relative precision, though the step
  !> is long and goes far beyond; no bounce is cut because its flank was just left.
  subroutine test_rearm()
    type(crossing_t) :: crossing
    real(wp) :: sigma
    integer :: i
    do i = 1, 15
      sigma = 10.0_wp**(-i)
      call search([0.0_wp, -sigma, 1.0_wp, 0.0_wp, 0.0_wp], separation, drive_flank, crossing)
      call expect(crossing, drive_flank, sigma, rounding*sigma, "a small bounce")
      call search([-1.0_wp, sigma, -1.0_wp, 0.0_wp, 0.0_wp], separation, coast_flank, crossing)
      call expect(crossing, coast_flank, sigma, rounding*sigma, "a small bounce at the coast flank")
      ! Rounding put the ball 1e-17 beyond the flank it leaves: that is no impact.
      call search([1.0e-17_wp, -sigma, 1.0_wp, 0.0_wp, 0.0_wp], separation, drive_flank, crossing)
      call expect(crossing, drive_flank, sigma, rounding*sigma, "a small bounce from beyond")
    end do
    call search([0.0_wp, -1.0_wp, -1.0_wp, 0.0_wp, 0.0_wp]/4, separation, drive_flank, crossing)
    call tally%is_true(.not. crossing%found, "leaving for good")
  end subroutine test_rearm

  !> Distances that begin at, below or above zero.
  subroutine test_first_descent()
    real(wp) :: c(0:5), at
    logical :: found
    c = [-1.0e-18_wp, -1.0_wp, 5.0_wp, 0.0_wp, 0.0_wp, 0.0_wp]
    call first_descent(c, 1.0_wp, .false., found, at)
    call tally%is_true(found .and. at <= 0, "below and falling: at once")
    c = [0.0_wp, -1.0_wp, 5.0_wp, 0.0_wp, 0.0_wp, 0.0_wp]
    call first_descent(c, 1.0_wp, .false., found, at)
    call tally%is_true(found .and. at <= 0, "exactly at zero and falling: at once")
    c = [0.0_wp, 0.0_wp, -1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp]
    call first_descent(c, 1.0_wp, .false., found, at)
    call tally%is_true(found .and. at <= 0, "exactly at zero and beginning to fall: at once")
    c = [0.0_wp, 1.0_wp, -2.0_wp, 0.0_wp, 0.0_wp, 0.0_wp]
    call first_descent(c, 1.0_wp, .false., found, at)
    call tally%is_true(found, "leaves and comes back")
    call tally%near(at, 0.5_wp, rounding, "leaves and comes back")
    c = [0.0_wp, 1.0_wp, 2.0_wp, 0.0_wp, 0.0_wp, 0.0_wp]
    call first_descent(c, 1.0_wp, .false., found, at)
    call tally%is_true(.not. found, "leaves for good")
    c = 0
    call first_descent(c, 1.0_wp, .false., found, at)
    call tally%is_true(.not. found, "stays at zero")
    ! Known to leave: leading coefficients that deny it are rounding.
    c = [-1.0e-18_wp, -1.0e-18_wp, 1.0_wp, -2.0_wp, 0.0_wp, 0.0_wp]
    call first_descent(c, 1.0_wp, .true., found, at)
    call tally%is_true(found, "left the flank, comes back")
    call tally%near(at, 0.5_wp, rounding, "left the flank, comes back")
  end subroutine test_first_descent

  !> In contact only the own flank matters, and what ends contact is coming back to it.
  subroutine test_release()
    type(crossing_t) :: crossing
    call search([0.1_wp, -0.4_wp, -1.0_wp, -1.0_wp, 0.0_wp], engagement, no_flank, crossing)
    call tally%is_true(crossing%found, "release")
    call tally%equal(crossing%flank, drive_flank, "release: flank")
    call tally%near(horner([0.1_wp, -0.4_wp, -1.0_wp, -1.0_wp], crossing%s/h), 0.0_wp, rounding, &
        "release: at the flank")
    call search([0.0_wp, 1.0_wp, -4.0_wp, 0.0_wp, 0.0_wp], engagement, drive_flank, crossing)
    call expect(crossing, drive_flank, 0.25_wp, rounding, "release of what has just engaged")
  end subroutine test_release

  !> Without a coast flank nothing is searched there.
  subroutine test_one_flank()
    type(crossing_t) :: crossing
    call search([-0.5_wp, -4.0_wp, 0.0_wp, 0.0_wp, 0.0_wp], separation, no_flank, crossing, 1)
    call tally%is_true(.not. crossing%found, "no coast flank")
  end subroutine test_one_flank

  !> One cubic flank as one piece and cut into four: the same crossings, to rounding over slope.
  subroutine test_pieces()
    real(wp) :: knots(5), c(0:5, 4), s(2), phi_dot
    integer :: i, flank(2)
    knots = [0.0_wp, 0.2_wp, 0.37_wp, 0.6_wp, 1.0_wp]
    do i = 1, 4
      associate (x => knots(i))
        c(:, i) = [0.5_wp*x**3 - 0.5_wp*x, 1.5_wp*x**2 - 0.5_wp, 1.5_wp*x, 0.5_wp, 0.0_wp, 0.0_wp]
      end associate
    end do
    do i = 1, 60
      phi_dot = -1.5_wp + 0.05_wp*i
      call flight(knots([1, 5]), c(:, 1:1), phi_dot, s(1), flank(1))
      call flight(knots, c, phi_dot, s(2), flank(2))
      call tally%equal(flank(2), flank(1), "flank met across pieces")
      ! Approach velocities stay above 0.1 here; g and its pieces are below 1.
      call tally%near(s(2), s(1), 10*rounding*10, "time met across pieces")
    end do
  end subroutine test_pieces

  !> One step over the whole mesh period from phi = -0.4: flank met and when.
  subroutine flight(knots, c, phi_dot, s, flank)
    real(wp), intent(in) :: knots(:), c(0:, :)   !! table
    real(wp), intent(in) :: phi_dot              !! velocity at the beginning
    real(wp), intent(out) :: s                   !! when
    integer, intent(out) :: flank                !! which
    type(oscillator_t) :: gear
    type(parameters_t) :: p
    type(instant_t) :: instant
    type(frame_t) :: frame
    type(motion_t) :: motion
    type(crossing_t) :: crossing
    type(work_t) :: work
    real(wp) :: z(max_states), z_end(max_states), error(max_states)
    p%force = 0.5_wp
    p%mesh_frequency_ratio = 3
    gear = oscillator(p, knots, c, spread(.false., 1, size(knots) - 1))
    instant = start_from(gear, 0.0_wp, separation, -0.4_wp, phi_dot)
    call gear%open_frame(instant, frame)
    z = instant%y
    call rk4_step(gear, frame, separation, frame%stop, z, motion, z_end, error)
    call find_crossing(gear, frame, separation, no_flank, motion, work, crossing)
    flank = merge(crossing%flank, 0, crossing%found)
    s = merge(crossing%s, 0.0_wp, crossing%found)
  end subroutine flight

  !> After polishing the formula itself is at the wall: x'' = -x, x = sin s, meets the wall at 0.3
  !> within rounding, and the event moves from the dense output's by no more than its error.
  subroutine test_polish()
    type(forced_mass_t) :: mass
    type(instant_t) :: instant
    type(frame_t) :: frame
    type(motion_t) :: motion
    type(crossing_t) :: crossing
    type(work_t) :: work
    real(wp) :: z(max_states), z_end(max_states), error(max_states), dense_s
    mass%wall = [0.3_wp, -9.0_wp]
    mass%period = 10
    instant%y(1:2) = [0.0_wp, 1.0_wp]
    call mass%open_frame(instant, frame)
    z = instant%y
    call rk4_step(mass, frame, separation, 0.5_wp, z, motion, z_end, error)
    call find_crossing(mass, frame, separation, no_flank, motion, work, crossing)
    call tally%is_true(crossing%found, "crossing of the oscillator")
    dense_s = crossing%s
    call polish_crossing(mass, frame, separation, motion%h, z, crossing, z_end, work)
    call tally%near(z_end(1), 0.3_wp, 10*epsilon(1.0_wp), "polished: at the wall")
    call tally%below(abs(crossing%s - dense_s), 2*error(1), "polished: near the dense output")
    call tally%below(work%polish_steps, 8.0_wp, "polished: steps")
  end subroutine test_polish
end program test_event_search
