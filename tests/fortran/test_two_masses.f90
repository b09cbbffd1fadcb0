!> Two degrees of freedom through the same formula and automaton, nothing changed: two masses in a
!> row, coupled by a spring; the first one hits a wall.
program test_two_masses
  use assertions, only: tally_t
  use lapwing_flow_rk4_rk4_flow, only: rk4_flow_t
  use lapwing_hybrid_automaton, only: advance
  use lapwing_codes, only: engagement, event_impact, event_engage, event_release, &
      event_chatter_end, status_ok
  use lapwing_contact_compliant, only: compliant_t
  use lapwing_contact_impact, only: relative_impact_t
  use lapwing_flow, only: work_t
  use lapwing_hybrid_state, only: hybrid_state_t, numerics_t, segment_t, event_t
  use lapwing_kinds, only: wp
  use test_systems, only: two_masses_t
  implicit none

  !> Equal masses and ground springs: modes x1 + x2 and x1 - x2.
  real(wp), parameter :: coupling = 0.7_wp, slow = 1, fast = sqrt(1 + 2*coupling)
  type(tally_t) :: tally

  call test_modes()
  call test_energy()
  call test_compliant()
  call test_chatter_end()
  call tally%finish()

contains

  !> x1, v1, x2, v2 a time s after y, without the wall: both modes in closed form.
  pure function modal(y, s) result(moved)
    real(wp), intent(in) :: y(4)   !! state
    real(wp), intent(in) :: s      !! time
    real(wp) :: moved(4), sum_(2), difference(2)
    sum_ = turned(y(1:2) + y(3:4), slow, s)
    difference = turned(y(1:2) - y(3:4), fast, s)
    moved = [sum_ + difference, sum_ - difference]/2
  end function modal

  pure function turned(q, w, s) result(moved)
    real(wp), intent(in) :: q(2)   !! position and velocity
    real(wp), intent(in) :: w, s   !! frequency, time
    real(wp) :: moved(2)
    moved = [q(1)*cos(w*s) + q(2)*sin(w*s)/w, q(2)*cos(w*s) - q(1)*w*sin(w*s)]
  end function turned

  !> Time from y to the wall at 0: scanned in steps of 0.01, then halved to the last bits.
  real(wp) function time_to_wall(y) result(s)
    real(wp), intent(in) :: y(4)   !! state
    real(wp) :: ahead(4), lower, upper
    integer :: i
    upper = 0.01_wp
    do
      ahead = modal(y, upper)
      if (ahead(1) > 0) exit
      upper = upper + 0.01_wp
    end do
    lower = upper - 0.01_wp
    do i = 1, 60
      s = 0.5_wp*(lower + upper)
      ahead = modal(y, s)
      if (ahead(1) > 0) upper = s
      if (ahead(1) <= 0) lower = s
    end do
  end function time_to_wall

  !> Advance to the next event of a kind.
  subroutine next_event(masses, numerics, state, work, kind, event)
    type(two_masses_t), intent(in) :: masses        !! what moves
    type(numerics_t), intent(in) :: numerics        !! tolerances
    type(hybrid_state_t), intent(inout) :: state    !! state
    type(work_t), intent(inout) :: work             !! counts
    integer, intent(in) :: kind                     !! kind waited for
    type(event_t), intent(out) :: event             !! the event
    type(segment_t) :: segment
    integer :: status, calls
    do calls = 1, 100000
      call advance(masses, rk4_flow_t(), numerics, state, segment, work, status)
      call tally%equal(status, status_ok, "advance: status")
      if (segment%n_events == 0) cycle
      event = segment%events(1)
      if (event%kind == kind) return
    end do
    call tally%is_true(.false., "an event that never came")
  end subroutine next_event

  !> Ten impacts against the closed form, for two tolerances. Between impacts the flow keeps energy,
  !> so errors add up; at an impact they grow by at most (1 + eps)|acceleration|/|velocity|, which
  !> in this motion multiplies to less than 100 over all ten. Allowed: steps*tolerance/256*100.
  subroutine test_modes()
    integer, parameter :: impacts = 10
    real(wp), parameter :: eps = 0.9_wp
    type(two_masses_t) :: masses
    type(hybrid_state_t) :: state
    type(numerics_t) :: numerics
    type(work_t) :: work
    type(event_t) :: event
    real(wp) :: y(4), time, s, worst
    integer :: i, k
    masses%coupling = coupling
    masses%law = relative_impact_t(restitution=eps)
    masses%n_states = 4
    masses%n_flanks = 1
    masses%period = 5
    do k = 6, 10, 2
      numerics%tolerance = 10.0_wp**(-k)
      y = [-1.0_wp, 0.0_wp, 0.5_wp, 0.3_wp]
      state = hybrid_state_t()
      state%instant%y(1:4) = y
      work = work_t()
      time = 0
      worst = 0
      do i = 1, impacts
        s = time_to_wall(y)
        time = time + s
        y = modal(y, s)
        call next_event(masses, numerics, state, work, event_impact, event)
        worst = max(worst, abs(event%cycle*masses%period + event%t - time))
        worst = max(worst, abs(event%before - y(2)))
        y(1:2) = [0.0_wp, -eps*y(2)]
        worst = max(worst, maxval(abs(state%instant%y(1:4) - y)))
        call tally%near(event%after, -eps*event%before, 0.0_wp, "impact law")
      end do
      print "(a, es8.1, a, es9.2, a, f8.0)", "measured: two masses, rtol ", numerics%tolerance, &
          ": off by ", worst, ", steps ", work%steps
      call tally%below(worst, 100*work%steps*numerics%tolerance/256, "two masses, ten impacts")
    end do
  end subroutine test_modes

  pure real(wp) function energy(masses, y)
    type(two_masses_t), intent(in) :: masses   !! the system
    real(wp), intent(in) :: y(:)               !! x1, v1, x2, v2
    energy = 0.5_wp*(masses%mass(1)*y(2)**2 + masses%mass(2)*y(4)**2 &
        + masses%stiffness(1)*y(1)**2 + masses%stiffness(2)*y(3)**2 &
        + masses%coupling*(y(1) - y(3))**2 &
        + masses%wall_stiffness*max(y(1) - masses%wall(1), 0.0_wp)**2)
  end function energy

  !> Unequal masses: an impact takes (1 - eps**2) m1 v1**2/2 and nothing else, and the other mass
  !> does not feel it at the instant.
  subroutine test_energy()
    type(two_masses_t) :: masses
    type(hybrid_state_t) :: state
    type(numerics_t) :: numerics
    type(work_t) :: work
    type(event_t) :: event
    real(wp) :: left, before, worst
    integer :: i
    masses%n_states = 4
    masses%n_flanks = 1
    masses%mass = [1.0_wp, 2.5_wp]
    masses%stiffness = [0.4_wp, 1.3_wp]
    masses%wall(1) = 0.1_wp
    masses%law = relative_impact_t(restitution=0.8_wp)
    masses%period = 5
    state%instant%y(1:4) = [-1.0_wp, 0.2_wp, 0.7_wp, -0.1_wp]
    left = energy(masses, state%instant%y)
    worst = 0
    do i = 1, 12
      call next_event(masses, numerics, state, work, event_impact, event)
      before = energy(masses, state%instant%y) &
          + 0.5_wp*masses%mass(1)*(event%before**2 - event%after**2)
      worst = max(worst, abs(before - left))
      left = energy(masses, state%instant%y)
      call tally%near(state%instant%y(1), masses%wall(1), 0.0_wp, "on the wall exactly")
      call tally%near(left, before - 0.18_wp*masses%mass(1)*event%before**2, 20*epsilon(left), &
          "energy lost at an impact")
    end do
    print "(a, es9.2, a, f8.0)", "measured: energy off between impacts by ", worst, ", steps ", &
        work%steps
    ! Energy per unit of a coordinate is at most 3 here.
    call tally%below(worst, 3*work%steps*numerics%tolerance/256, "energy between impacts")
  end subroutine test_energy

  !> A wall that is a spring: engage and release instead of impacts, the energy stays.
  subroutine test_compliant()
    type(two_masses_t) :: masses
    type(hybrid_state_t) :: state
    type(numerics_t) :: numerics
    type(work_t) :: work
    type(event_t) :: event
    real(wp) :: initially, worst
    integer :: i
    masses%n_states = 4
    masses%n_flanks = 1
    masses%law = compliant_t()
    masses%wall_stiffness = 50
    masses%period = 5
    state%instant%y(1:4) = [-1.0_wp, 0.2_wp, 0.7_wp, -0.1_wp]
    initially = energy(masses, state%instant%y)
    worst = 0
    do i = 1, 20
      call next_event(masses, numerics, state, work, event_engage, event)
      worst = max(worst, abs(energy(masses, state%instant%y) - initially))
      call tally%equal(state%instant%motion_state, engagement, "compliant: engaged")
      call next_event(masses, numerics, state, work, event_release, event)
      worst = max(worst, abs(energy(masses, state%instant%y) - initially))
    end do
    print "(a, es9.2, a, f8.0)", "measured: energy with a compliant wall off by ", worst, &
        ", steps ", work%steps
    ! Energy per unit of a coordinate: wall_stiffness*penetration, at most 50*0.3.
    call tally%below(worst, 15*work%steps*numerics%tolerance/256, "energy with a compliant wall")
  end subroutine test_compliant

  !> While the chatter of the first mass is summed the second one goes on: over a duration L by
  !> v2 L + a2 L**2/2, where |a2| < 4 here.
  subroutine test_chatter_end()
    type(two_masses_t) :: masses
    type(hybrid_state_t) :: state, before
    type(numerics_t) :: numerics
    type(work_t) :: work
    type(segment_t) :: segment
    integer :: status, calls
    masses%n_states = 4
    masses%n_flanks = 1
    masses%wall(1) = -0.5_wp
    masses%law = relative_impact_t(restitution=0.3_wp)
    masses%wall_stiffness = 50
    masses%period = 5
    state%instant%y(1:4) = [-0.6_wp, 0.0_wp, 0.8_wp, 1.0_wp]
    do calls = 1, 10000
      before = state
      call advance(masses, rk4_flow_t(), numerics, state, segment, work, status)
      call tally%equal(status, status_ok, "advance: status")
      if (segment%n_events == 0) cycle
      if (segment%events(1)%kind == event_chatter_end) exit
    end do
    call tally%is_true(calls < 10000, "the chatter ends")
    associate (y => before%instant%y, length => segment%length)
      call tally%is_true(length > 1.0e-9_wp, "the end of the chatter takes time")
      call tally%near(state%instant%y(3), y(3) + length*y(4), 2*length**2 + 4*epsilon(length), &
          "the other mass moves on while the chatter is summed")
      call tally%is_true(abs(length*y(4)) > 100*(2*length**2 + epsilon(length)), &
          "which is more than standing still")
    end associate
  end subroutine test_chatter_end
end program test_two_masses
