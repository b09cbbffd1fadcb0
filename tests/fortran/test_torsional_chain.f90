!> Two bodies: their relative motion is the oscillator's to the last bit, and what the pair of them
!> must keep, momentum and energy, is kept.
module bodies_with_accounts
  use lapwing_kinds, only: wp
  use lapwing_codes, only: separation, drive_flank
  use lapwing_system_frames, only: flank_in_frame
  use lapwing_system_parameters, only: parameters_t
  use lapwing_system_step, only: step_t, lengths_t
  use lapwing_system_torsional_chain, only: torsional_chain_t, make_torsional_chain
  use lapwing_system, only: instant_t, frame_t, motion_t, max_states
  implicit none
  private
  public :: bodies_t, accounts_t, set_torques, velocities, kinetic_energy, with_accounts
  public :: torsional_chain

  !> The two wheels, in units in which the natural frequency is one.
  type :: bodies_t
    real(wp) :: inertia(2) = [1.7_wp, 2.9_wp]   !! J1, J2
    real(wp) :: ratio = 1.3_wp                  !! i12
    real(wp) :: torque(2) = 0                   !! T_m on the first, T_l braking the second
    real(wp) :: total = 0                       !! i12**2 J1 + J2
    real(wp) :: reduced = 0                     !! J, and the mesh stiffness too
  end type bodies_t

  !> The chain with three integrals more: work of the torques, work of the flank's motion, loss in
  !> the damper, each from the bodies' own velocities and torques.
  type, extends(torsional_chain_t) :: accounts_t
    type(bodies_t) :: bodies                    !! the wheels
  contains
    procedure :: derivatives, stages, stay, commit, scales
  end type accounts_t

contains

  !> Torques on the bodies, and what the chain makes of them.
  pure subroutine set_torques(bodies, drive, brake, p)
    type(bodies_t), intent(inout) :: bodies       !! the wheels
    real(wp), intent(in) :: drive, brake          !! T_m, T_l
    type(parameters_t), intent(inout) :: p        !! force and mean acceleration are set
    associate (j => bodies%inertia)
      bodies%torque = [drive, brake]
      bodies%total = bodies%ratio**2*j(1) + j(2)
      bodies%reduced = j(1)*j(2)/bodies%total
      p%force = drive/j(1) + bodies%ratio*brake/j(2)
      p%mean_acceleration = (bodies%ratio*drive - brake)/bodies%total
    end associate
  end subroutine set_torques

  !> theta1' and theta2' from theta' and Theta'.
  pure function velocities(bodies, relative, mean) result(each)
    type(bodies_t), intent(in) :: bodies          !! the wheels
    real(wp), intent(in) :: relative, mean        !! theta', Theta'
    real(wp) :: each(2)
    each(2) = mean - bodies%ratio*bodies%inertia(1)/bodies%total*relative
    each(1) = relative + bodies%ratio*each(2)
  end function velocities

  pure real(wp) function kinetic_energy(bodies, each)
    type(bodies_t), intent(in) :: bodies          !! the wheels
    real(wp), intent(in) :: each(2)               !! their velocities
    kinetic_energy = 0.5_wp*sum(bodies%inertia*each**2)
  end function kinetic_energy

  function torsional_chain(p, knots, coefficients, kinks) result(self)
    type(parameters_t), intent(in) :: p           !! see `make_torsional_chain`, as the rest
    real(wp), intent(in) :: knots(:), coefficients(0:, :)
    logical, intent(in) :: kinks(:)
    type(torsional_chain_t) :: self
    real(wp), parameter :: none(3, 1) = reshape([-1.0_wp, 0.0_wp, 0.0_wp], [3, 1])
    integer :: error
    call make_torsional_chain(p, knots, coefficients, kinks, none, self, error)
    if (error /= 0) error stop "no memory"
  end function torsional_chain

  function with_accounts(bodies, p, knots, coefficients, kinks) result(self)
    type(bodies_t), intent(in) :: bodies          !! the wheels
    type(parameters_t), intent(in) :: p           !! see `make_torsional_chain`, as the rest
    real(wp), intent(in) :: knots(:), coefficients(0:, :)
    logical, intent(in) :: kinks(:)
    type(accounts_t) :: self
    self%torsional_chain_t = torsional_chain(p, knots, coefficients, kinks)
    self%n_states = 7
    self%bodies = bodies
  end function with_accounts

  pure subroutine derivatives(self, frame, motion_state, s, z, rate)
    class(accounts_t), intent(in) :: self
    type(frame_t), intent(in) :: frame
    integer, intent(in) :: motion_state
    real(wp), intent(in) :: s
    real(wp), intent(in) :: z(:)
    real(wp), intent(out) :: rate(:)
    real(wp) :: each(2), mesh, position, slope
    call self%torsional_chain_t%derivatives(frame, motion_state, s, z(:4), rate(:4))
    each = velocities(self%bodies, frame%origin_rate + z(2), z(4))
    rate(5) = self%bodies%torque(1)*each(1) - self%bodies%torque(2)*each(2)
    rate(6:7) = 0
    if (motion_state == separation) return
    mesh = self%bodies%reduced*(self%force - rate(2))
    position = 0
    slope = 0
    if (self%moves(frame%chart)) then
      call flank_in_frame(self%path, frame, s, position, slope)
    end if
    rate(6) = -mesh*(frame%origin_rate + slope)
    rate(7) = self%bodies%reduced*self%damping*(z(2) - slope)**2
  end subroutine derivatives

  !> Left to the formula, which integrates the accounts too.
  subroutine stages(self, frame, motion_state, h, z, lengths, step, done)
    class(accounts_t), intent(in) :: self
    type(frame_t), intent(in) :: frame
    integer, intent(in) :: motion_state
    real(wp), intent(in) :: h
    real(wp), intent(in) :: z(max_states)
    type(lengths_t), intent(inout), optional :: lengths
    type(step_t), intent(inout) :: step
    logical, intent(out) :: done
    done = .false.
  end subroutine stages

  !> Looked at piece by piece: the formula does not say where the flank is at the end.
  pure subroutine stay(self, frame, begin, motion, z_end, y, stays)
    class(accounts_t), intent(in) :: self
    type(frame_t), intent(in) :: frame
    type(instant_t), intent(in) :: begin
    type(motion_t), intent(in) :: motion
    real(wp), intent(in) :: z_end(max_states)
    real(wp), intent(inout) :: y(max_states)
    logical, intent(out) :: stays
    stays = .false.
  end subroutine stay

  pure subroutine commit(self, frame, s, z, chart, y)
    class(accounts_t), intent(in) :: self
    type(frame_t), intent(in) :: frame
    real(wp), intent(in) :: s
    real(wp), intent(in) :: z(max_states)
    integer, intent(in) :: chart
    real(wp), intent(out) :: y(max_states)
    call self%torsional_chain_t%commit(frame, s, z, chart, y)
    y(5:7) = z(5:7)
  end subroutine commit

  pure subroutine scales(self, motion_state, scale)
    class(accounts_t), intent(in) :: self
    integer, intent(in) :: motion_state
    real(wp), intent(out) :: scale(max_states)
    call self%torsional_chain_t%scales(motion_state, scale)
    scale(5:7) = scale(2)
  end subroutine scales
end module bodies_with_accounts

program test_torsional_chain
  use, intrinsic :: ieee_arithmetic, only: ieee_is_nan
  use assertions, only: tally_t
  use bodies_with_accounts, only: bodies_t, accounts_t, set_torques, velocities, kinetic_energy, &
      with_accounts, torsional_chain
  use lapwing_codes, only: separation, drive_flank, coast_flank, event_impact, event_chatter_end, &
      event_kind, law_compliant, law_absolute, law_relative, gap_one_flank, gap_symmetric, status_ok
  use lapwing_flow, only: work_t
  use lapwing_flow_rk4_rk4_flow, only: rk4_flow_t
  use lapwing_hybrid_automaton, only: advance
  use lapwing_hybrid_state, only: hybrid_state_t, numerics_t, segment_t
  use lapwing_kinds, only: wp
  use lapwing_observers_records, only: recorder_t, cycle_columns, log_columns
  use lapwing_run, only: run_to, deadline_in
  use lapwing_system_oscillator, only: oscillator_t
  use test_systems, only: oscillator
  use lapwing_system_parameters, only: parameters_t
  use lapwing_system_start, only: start_from
  use lapwing_system_torsional_chain, only: torsional_chain_t
  implicit none

  real(wp), parameter :: period = 4, knots(3) = [0.0_wp, 0.5_wp, 1.0_wp]
  logical, parameter :: kinks(2) = [.true., .false.]
  type(tally_t) :: tally
  type(bodies_t) :: bodies
  type(parameters_t) :: base
  real(wp) :: te(0:5, 2)

  ! Curvature and its rate jump in the middle, the slope at phase 0.
  te(:, 1) = [0.02_wp, 0.1_wp, 0.3_wp, -0.4_wp, 0.2_wp, 0.1_wp]
  te(:, 2) = 0
  te(0:1, 2) = [sum(te(:, 1)*0.5_wp**[0, 1, 2, 3, 4, 5]), &
      sum([1, 2, 3, 4, 5]*te(1:, 1)*0.5_wp**[0, 1, 2, 3, 4])]
  te(2:3, 2) = [-0.5_wp, 0.3_wp]
  base%mesh_frequency_ratio = 8*atan(1.0_wp)/period
  base%damping_ratio = 0.15_wp
  base%restitution = 0.8_wp
  base%backlash = 3
  base%peak_to_peak = 0.2_wp
  base%tolerance = 1.0e-12_wp
  call test_relative_motion()
  call test_mean_motion()
  call test_impulse_pair(law_relative)
  call test_impulse_pair(law_absolute)
  call test_energy()
  call tally%finish()

contains

  !> Every law and flank: the same log, the same cycles, bit for bit, balanced or not. The mean
  !> rotation feeds nothing back.
  subroutine test_relative_motion()
    type(parameters_t) :: p
    call same_motion(0.4_wp, 0.5_wp, base, "relative")
    p = base
    p%impact_law = law_absolute
    call same_motion(0.4_wp, 0.52_wp, p, "absolute")
    p%contact_law = law_compliant
    p%impact_law = law_relative
    call same_motion(0.008_wp, 0.0104_wp, p, "compliant")
    p = base
    p%gap = gap_one_flank
    call same_motion(0.05_wp, 0.075_wp, p, "one flank")
    p%gap = gap_symmetric
    p%backlash = 0.1_wp
    call same_motion(0.02_wp, 0.026_wp, p, "both flanks")
    p%back_flank_te = .false.
    p%backlash = 0.4_wp
    call same_motion(-0.05_wp, -0.065_wp, p, "standing coast flank")
    p = base
    p%restitution = 0.3_wp
    call same_motion(0.8_wp, 1.04_wp, p, "complete chatter")
  end subroutine test_relative_motion

  subroutine same_motion(drive, brake, given, what)
    real(wp), intent(in) :: drive, brake           !! torques
    type(parameters_t), intent(in) :: given        !! all but force and mean acceleration
    character(*), intent(in) :: what               !! in words
    type(parameters_t) :: p
    real(wp), target :: log(log_columns, 4000, 2), cycles(cycle_columns, 20, 2)
    integer :: lines(2)
    p = given
    call set_torques(bodies, drive, brake, p)
    log = 0
    cycles = 0
    call follow(oscillator(p, knots, te, kinks), log(:, :, 1), cycles(:, :, 1), lines(1))
    call follow(torsional_chain(p, knots, te, kinks), log(:, :, 2), cycles(:, :, 2), lines(2))
    call tally%equal(lines(2), lines(1), what//": lines of the log")
    call tally%is_true(lines(1) > 20 .and. lines(1) < size(log, 2), what//": a log worth comparing")
    ! Where an event ends no flight there is no depth.
    call tally%is_true(all(log(:, :, 1) == log(:, :, 2) &
        .or. (ieee_is_nan(log(:, :, 1)) .and. ieee_is_nan(log(:, :, 2)))), what//": same events")
    call tally%is_true(count(.not. ieee_is_nan(log(log_columns, :lines(1), 1))) > 10, &
        what//": depths worth comparing")
    call tally%is_true(all(cycles(:, :, 1) == cycles(:, :, 2)), what//": same cycles")
  end subroutine same_motion

  !> Twenty cycles with everything logged.
  subroutine follow(system, log, cycles, lines)
    class(oscillator_t), intent(in) :: system             !! what moves
    real(wp), intent(inout), target, contiguous :: log(:, :), cycles(:, :)
    integer, intent(out) :: lines                         !! lines of the log
    type(recorder_t) :: recorder
    type(hybrid_state_t) :: state
    type(work_t) :: work
    integer :: status
    recorder%want_events = .true.
    recorder%want_grazes = .true.
    recorder%graze_distance = 0.05_wp
    recorder%want_cycles = .true.
    recorder%log => log
    recorder%cycles => cycles
    state%instant = start_from(system, 0.0_wp, separation, -0.05_wp, 0.02_wp)
    call run_to(system, rk4_flow_t(), numerics_t(tolerance=base%tolerance), 20, 0.0_wp, &
        deadline_in(60.0_wp), state, recorder, work, status)
    call tally%equal(status, status_ok, "run: status")
    lines = recorder%sums%n_log
  end subroutine follow

  !> Theta' changes by the torques alone, whatever the teeth do: i12 J1 theta1' + J2 theta2' by
  !> i12 T_m - T_l. Each segment rounds Theta and Theta' once or twice, to 1e-16 of their size.
  subroutine test_mean_motion()
    type(parameters_t) :: p
    type(torsional_chain_t) :: chain
    type(hybrid_state_t) :: state
    type(segment_t) :: segment
    type(work_t) :: work
    real(wp) :: tau, each(2), slope, g
    integer :: status, impacts, segments
    p = base
    call set_torques(bodies, 0.3_wp, 0.5_wp, p)
    chain = torsional_chain(p, knots, te, kinks)
    state%instant = start_from(chain, 0.0_wp, separation, -0.05_wp, 0.02_wp)
    impacts = 0
    segments = 0
    do while (state%instant%cycle < 20)
      call advance(chain, rk4_flow_t(), numerics_t(), state, segment, work, status)
      segments = segments + 1
      if (segment%n_events > 0) impacts = impacts + count(segment%events(:1)%kind == event_impact)
      tau = state%instant%cycle*period + state%instant%t
      call tally%near(state%instant%y(4), p%mean_acceleration*tau, &
          2*segments*epsilon(tau)*abs(p%mean_acceleration)*tau, "Theta'")
      call tally%near(state%instant%y(3), 0.5_wp*p%mean_acceleration*tau**2, &
          4*segments*epsilon(tau)*abs(p%mean_acceleration)*tau**2, "Theta")
    end do
    call tally%is_true(impacts > 20, "impacts on the way")
    call chain%path%motion(state%instant%t, state%instant%piece, g, slope)
    each = velocities(bodies, state%instant%y(2) + slope, state%instant%y(4))
    associate (j => bodies%inertia)
      call tally%near(bodies%ratio*j(1)*each(1) + j(2)*each(2), &
          (bodies%ratio*bodies%torque(1) - bodies%torque(2))*tau, &
          4*segments*epsilon(tau)*tau, "momentum")
    end associate
  end subroutine test_mean_motion

  !> An impact is an impulse on each body, I on J1 and i12 I on J2. With the I that the law asks for
  !> the bodies' velocities fulfil it, and the engine's state after it is theirs.
  subroutine test_impulse_pair(law)
    integer, intent(in) :: law                     !! impact law
    type(parameters_t) :: p
    type(torsional_chain_t) :: chain
    type(hybrid_state_t) :: state, begin
    type(segment_t) :: segment
    type(work_t) :: work
    real(wp) :: before(2), after(2), g, slope, impulse, relative(2), wanted, allowed
    integer :: status, impacts
    p = base
    p%impact_law = law
    call set_torques(bodies, 0.3_wp, 0.5_wp, p)
    chain = torsional_chain(p, knots, te, kinks)
    state%instant = start_from(chain, 0.0_wp, separation, -0.05_wp, 0.02_wp)
    impacts = 0
    do while (state%instant%cycle < 10)
      begin = state
      call advance(chain, rk4_flow_t(), numerics_t(), state, segment, work, status)
      if (segment%n_events == 0) cycle
      if (segment%events(1)%kind /= event_impact) cycle
      impacts = impacts + 1
      associate (event => segment%events(1), j => bodies%inertia)
        call chain%path%motion(event%t, state%instant%piece, g, slope)
        relative = [event%before, event%after] + slope
        before = velocities(bodies, relative(1), &
            begin%instant%y(4) + p%mean_acceleration*segment%length)
        wanted = merge(-p%restitution*relative(1), slope - p%restitution*event%before, &
            law == law_absolute)
        impulse = -bodies%reduced*(wanted - relative(1))
        after = before + [-impulse/j(1), bodies%ratio*impulse/j(2)]
        allowed = 8*epsilon(allowed)*max(maxval(abs(before)), maxval(abs(after)))
        call tally%near(after(1) - bodies%ratio*after(2), wanted, allowed, "the law, by the bodies")
        call tally%near(relative(2), wanted, allowed, "the law, in the log")
        call tally%near(sum([bodies%ratio, 1.0_wp]*j*(after - before)), 0.0_wp, 4*allowed, &
            "momentum through an impact")
        after = after - velocities(bodies, relative(2), state%instant%y(4))
        call tally%below(maxval(abs(after)), allowed, "the state after it")
      end associate
    end do
    call tally%is_true(impacts > 15, "impacts")
  end subroutine test_impulse_pair

  !> Work of the torques and of the flank's motion is energy of the bodies and of the spring, and
  !> loss in damper and impacts.
  subroutine test_energy()
    type(parameters_t) :: p
    p = base
    call energy_kept(0.013_wp, 0.019_wp, p, [15, 0, 0, 0], "relative")
    p%impact_law = law_absolute
    call energy_kept(0.2_wp, 0.3_wp, p, [50, 0, 0, 0], "absolute")
    p%impact_law = law_relative
    p%contact_law = law_compliant
    call energy_kept(0.008_wp, 0.012_wp, p, [0, 0, 20, 0], "compliant")
    p%backlash = 0.1_wp
    call energy_kept(0.0032_wp, 0.00464_wp, p, [0, 0, 10, 2], "compliant, both flanks")
    p%contact_law = base%contact_law
    call energy_kept(0.02_wp, 0.03_wp, p, [30, 10, 0, 0], "relative, both flanks")
    p%back_flank_te = .false.
    p%backlash = 0.4_wp
    p%restitution = 0.99_wp
    call energy_kept(-0.02_wp, -0.03_wp, p, [0, 15, 0, 0], "standing coast flank")
  end subroutine test_energy

  subroutine energy_kept(drive, brake, given, least, what)
    real(wp), intent(in) :: drive, brake           !! torques
    type(parameters_t), intent(in) :: given        !! all but force and mean acceleration
    integer, intent(in) :: least(4)                !! impacts and releases, by flank, at least
    character(*), intent(in) :: what               !! in words
    type(parameters_t) :: p
    type(accounts_t) :: chain
    type(hybrid_state_t) :: state
    type(segment_t) :: segment
    type(work_t) :: work
    real(wp) :: initially, impacts, flank, worst, moved
    integer :: status, i, counts(10)
    p = given
    call set_torques(bodies, drive, brake, p)
    chain = with_accounts(bodies, p, knots, te, kinks)
    state%instant = start_from(chain, 0.0_wp, separation, -0.05_wp, 0.02_wp)
    initially = energy(chain, state)
    impacts = 0
    flank = 0
    worst = 0
    moved = 0
    counts = 0
    do while (state%instant%cycle < 40)
      call advance(chain, rk4_flow_t(), numerics_t(tolerance=p%tolerance), state, segment, work, &
          status)
      call tally%equal(status, status_ok, "advance: status")
      do i = 1, segment%n_events
        associate (event => segment%events(i))
          counts(event%kind) = counts(event%kind) + 1
          if (event%kind > event_kind(event_impact, coast_flank)) cycle
          impacts = impacts + 0.5_wp*bodies%reduced*(event%before**2 - event%after**2)
          flank = flank - bodies%reduced*(event%before - event%after)*speed(chain, state, &
              drive_flank + event%kind - event_impact)
        end associate
      end do
      associate (y => state%instant%y)
        worst = max(worst, abs(energy(chain, state) - initially - y(5) - y(6) - flank + y(7) &
            + impacts))
        moved = max(moved, abs(y(5)), abs(y(6) + flank), y(7), impacts)
      end associate
    end do
    print "(3a, es9.2, a, es9.2, a, f8.0)", "measured: ", what, ": energy off by ", worst, &
        ", moved ", moved, ", steps ", work%steps
    call tally%is_true(all(counts(:4) >= least), what//": events")
    call tally%equal(sum(counts(event_chatter_end:event_chatter_end + 1)), 0, &
        what//": every impact is listed")
    ! A step errs by tolerance/256 of the scales, in velocities below 1 here, and energy per unit
    ! of a velocity is M Theta' + J theta' < 30.
    call tally%below(worst, 30*work%steps*p%tolerance/256, what//": energy")
    call tally%is_true(moved > 1.0e-3_wp, what//": energy that could be lost")
  end subroutine energy_kept

  !> Velocity of a flank where the state is.
  real(wp) function speed(chain, state, flank)
    type(accounts_t), intent(in) :: chain          !! the bodies
    type(hybrid_state_t), intent(in) :: state      !! where they are
    integer, intent(in) :: flank                   !! flank
    real(wp) :: g
    speed = 0
    if (.not. chain%moves(flank)) return
    call chain%path%motion(state%instant%t, state%instant%piece, g, speed)
  end function speed

  !> Of the bodies and of the spring.
  real(wp) function energy(chain, state)
    type(accounts_t), intent(in) :: chain          !! the bodies
    type(hybrid_state_t), intent(in) :: state      !! where they are
    real(wp) :: relative
    associate (instant => state%instant)
      relative = instant%y(2) + speed(chain, state, instant%chart)
      energy = kinetic_energy(bodies, velocities(bodies, relative, instant%y(4)))
      if (instant%motion_state /= separation) then
        energy = energy + 0.5_wp*bodies%reduced*instant%y(1)**2
      end if
    end associate
  end function energy
end program test_torsional_chain
