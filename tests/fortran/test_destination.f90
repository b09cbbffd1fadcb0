!> When a run counts as a motion that is known: by an ellipse, by returns, by cells, or not at all;
!> and that a run cut between two calls ends the same.
program test_destination
  use assertions, only: tally_t
  use lapwing_kinds, only: wp, int64
  use lapwing_codes, only: engagement, separation, law_restitution, law_relative, gap_one_flank, &
      end_unknown, end_certain, end_presumed, status_ok
  use lapwing_flow_exact_exact_flow, only: exact_flow_t, make_exact_flow
  use lapwing_hybrid_state, only: numerics_t
  use lapwing_run_destination, only: known_t, follow_starts, goal_columns, end_columns, &
      suspended_size
  use lapwing_system_oscillator, only: oscillator_t
  use lapwing_system_parameters, only: parameters_t
  use test_systems, only: oscillator
  implicit none

  !> A tooth on a flank that stands still: phi = F + (phi0 - F) exp(-xi tau) (...), F = 1.
  real(wp), parameter :: start(4, 1) = reshape([1.0_wp, 1.5_wp, 0.0_wp, 0.0_wp], [4, 1])
  integer(int64), parameter :: never = huge(1_int64)
  type(oscillator_t), target :: system
  type(exact_flow_t) :: flow
  real(wp), target :: goals(goal_columns, 1)
  integer, target :: cells(2, 2)
  type(tally_t) :: tally
  integer :: error

  system = tooth()
  call make_exact_flow(system, flow, error)
  call tally%is_true(error == 0, "memory")
  call test_ellipse()
  call test_returns()
  call test_cells()
  call test_cut()
  call tally%finish()

contains

  function tooth() result(self)
    type(oscillator_t) :: self
    type(parameters_t) :: p
    real(wp) :: coefficients(0:5, 1)
    p%contact_law = law_restitution
    p%impact_law = law_relative
    p%gap = gap_one_flank
    p%force = 1
    p%mesh_frequency_ratio = 1
    p%flank_scale = 1
    p%peak_to_peak = 0
    p%damping_ratio = 0.05_wp
    p%restitution = 0.5_wp
    p%backlash = 10
    coefficients = 0
    self = oscillator(p, [0.0_wp, 1.0_wp], coefficients, [.false.])
  end function tooth

  !> A goal where the tooth comes to rest; both limits in V = (phi - 1)**2 + phi'**2.
  subroutine set_goal(certain, presumed)
    real(wp), intent(in) :: certain, presumed     !! limits
    goals(:, 1) = [3.0_wp, real(engagement, wp), 1.0_wp, 1.0_wp, 0.0_wp, 1.0_wp, 0.0_wp, 1.0_wp, &
        certain, presumed]
  end subroutine set_goal

  !> How a run ends.
  function ended(known, deadline, calls) result(ends)
    type(known_t), intent(in) :: known            !! what is known
    integer(int64), intent(in) :: deadline        !! of each call
    integer, intent(out) :: calls                 !! calls that it took
    real(wp) :: ends(end_columns), both(end_columns, 1), suspended(suspended_size)
    suspended = 0
    suspended(1) = 1
    both = -1
    calls = 0
    do while (nint(suspended(1)) <= 1)
      call follow_starts(system, flow, numerics_t(), known, start, deadline, suspended, both)
      calls = calls + 1
    end do
    ends = both(:, 1)
  end function ended

  type(known_t) function known_with(most_cycles, returns, recurrences) result(known)
    integer, intent(in) :: most_cycles, returns, recurrences   !! see `known_t`
    known%goals => goals
    known%cells => cells
    known%box = [0.9_wp, 1.1_wp, -0.1_wp, 0.1_wp]
    known%most_cycles = most_cycles
    known%returns = returns
    known%recurrences = recurrences
  end function known_with

  !> In a cycle the distance shrinks by exp(-2 pi 0.05) = 0.73: the first cycle that begins
  !> within 0.01 is the 13th (0.5*0.73**12 = 0.0115), within the ellipse with certainty.
  subroutine test_ellipse()
    real(wp) :: ends(end_columns)
    integer :: calls
    cells = 0
    call set_goal(1.0e-4_wp, -1.0_wp)
    ends = ended(known_with(100, 1000, 1000), never, calls)
    call tally%is_true(all(nint(ends(1:5)) == [status_ok, 3, end_certain, 13, engagement]), &
        "certain in the 13th cycle")
    call tally%below((ends(6) - 1)**2 + ends(7)**2, 1.0e-4_wp, "within the ellipse")
    ends = ended(known_with(12, 1000, 1000), never, calls)
    call tally%is_true(all(nint(ends(1:4)) == [status_ok, 0, end_unknown, 12]), "not in twelve")
    goals(2, 1) = separation
    ends = ended(known_with(100, 1000, 1000), never, calls)
    call tally%is_true(all(nint(ends(1:4)) == [status_ok, 0, end_unknown, 100]), &
        "in another motion state it is no goal")
  end subroutine test_ellipse

  !> Within 0.1 from the 6th cycle on (0.5*0.73**5 = 0.104); four returns later it is presumed.
  subroutine test_returns()
    real(wp) :: ends(end_columns)
    integer :: calls
    cells = 0
    call set_goal(-1.0_wp, 0.01_wp)
    ends = ended(known_with(100, 4, 1000), never, calls)
    call tally%is_true(all(nint(ends(1:4)) == [status_ok, 3, end_presumed, 10]), &
        "presumed after four nearer returns")
    goals(3, 1) = 3
    ends = ended(known_with(100, 4, 1000), never, calls)
    call tally%is_true(nint(ends(4)) == 18, "each return takes a period")
  end subroutine test_returns

  !> Cells from 0.9 to 1.1 are entered by the 6th cycle; one of several motions neither counts nor
  !> ends the row.
  subroutine test_cells()
    real(wp) :: ends(end_columns)
    integer :: calls
    call set_goal(-1.0_wp, -1.0_wp)
    cells = 7
    ends = ended(known_with(100, 1000, 5), never, calls)
    call tally%is_true(all(nint(ends(1:4)) == [status_ok, 7, end_presumed, 10]), &
        "five cycles in its cells")
    cells = -1
    ends = ended(known_with(50, 1000, 5), never, calls)
    call tally%is_true(all(nint(ends(2:4)) == [0, end_unknown, 50]), "cells of several")
    cells = 0
    ends = ended(known_with(50, 1000, 5), never, calls)
    call tally%is_true(nint(ends(2)) == 0, "no cell of any")
  end subroutine test_cells

  !> Calls whose deadline has passed when they begin each go a little way, and end the same.
  subroutine test_cut()
    real(wp) :: whole(end_columns), cut(end_columns)
    integer :: calls
    cells = 0
    call set_goal(-1.0_wp, -1.0_wp)
    whole = ended(known_with(2000, 4, 4), never, calls)
    call tally%is_true(calls == 1, "one call")
    cut = ended(known_with(2000, 4, 4), 0_int64, calls)
    call tally%is_true(calls > 10, "many calls")
    call tally%is_true(all(transfer(whole, [0_int64]) == transfer(cut, [0_int64])), "the same bits")
  end subroutine test_cut
end program test_destination
