!> Rounds of cycles written again: when, how far, and what the records then hold.
program test_repetition
  use assertions, only: tally_t
  use lapwing_kinds, only: wp
  use lapwing_flow, only: work_t
  use lapwing_hybrid_state, only: hybrid_state_t
  use lapwing_observers_records, only: recorder_t, log_columns, cycle_columns, log_reserve
  use lapwing_run_cycle_detection, only: repetition_t, end_of_cycle
  implicit none

  integer, parameter :: room = 400
  real(wp), target :: log(log_columns, room), cycles(cycle_columns, room), samples(3, 1), &
      sample_time(2, 1)
  type(tally_t) :: tally

  call test_rounds()
  call test_short_records()
  call test_log_that_waits()
  call test_sample()
  call test_no_return()
  call test_other_sums()
  call tally%finish()

contains

  !> Run cycles of a motion with the given round until the state has been moved, or 100 of them.
  !> Each logs two lines and one line of statistics that show its place in the round.
  subroutine go_round(length, target_cycle, recorder, state, work, drift)
    integer, intent(in) :: length                    !! cycles of a round
    integer, intent(in) :: target_cycle              !! where the run ends
    type(recorder_t), intent(inout) :: recorder      !! what is recorded
    type(hybrid_state_t), intent(out) :: state       !! where it is afterwards
    type(work_t), intent(inout) :: work              !! counts
    real(wp), intent(in) :: drift                    !! of the deepest point, by cycle
    type(repetition_t) :: repetition
    integer :: i, k, place
    do i = 1, 100
      place = mod(i, length)
      do k = 1, 2
        recorder%sums%n_log = recorder%sums%n_log + 1
        if (recorder%sums%n_log <= size(recorder%log, 2)) recorder%log(:, recorder%sums%n_log) = &
            [real(k, wp), real(i - 1, wp), 0.25_wp*k, 0.0_wp, real(place, wp), 1.0_wp]
      end do
      recorder%sums%n_cycles = recorder%sums%n_cycles + 1
      if (recorder%sums%n_cycles <= size(recorder%cycles, 2)) then
        recorder%cycles(:, recorder%sums%n_cycles) = real(place, wp)
        recorder%cycles(1, recorder%sums%n_cycles) = i - 1
      end if
      work%arcs = work%arcs + 3
      state%instant%y(1:2) = [real(place, wp), -1.0_wp]
      state%instant%cycle = i
      recorder%sums%flight_depth_before = drift*i
      call end_of_cycle(repetition, target_cycle, state, recorder, work)
      if (state%instant%cycle /= i) return
    end do
  end subroutine go_round

  function new_recorder(n_log, n_cycles, waits) result(recorder)
    integer, intent(in) :: n_log, n_cycles           !! room
    logical, intent(in) :: waits                     !! whether a full log stops the run
    type(recorder_t) :: recorder
    recorder%want_events = waits
    recorder%want_impacts = .true.
    recorder%want_cycles = .true.
    recorder%log => log(:, :n_log)
    recorder%cycles => cycles(:, :n_cycles)
    log = -1
    cycles = -1
  end function new_recorder

  !> Rounds of any length are found, and written as they would have been computed.
  subroutine test_rounds()
    type(recorder_t) :: recorder
    type(hybrid_state_t) :: state
    type(work_t) :: work
    integer :: length, i
    logical :: right
    do length = 1, 7
      recorder = new_recorder(room, room, .false.)
      work = work_t()
      call go_round(length, 150, recorder, state, work, 0.0_wp)
      call tally%is_true(state%instant%cycle > 150 - length .and. state%instant%cycle <= 150, &
          "as far as whole rounds lead")
      call tally%is_true(recorder%sums%n_cycles == state%instant%cycle &
          .and. recorder%sums%n_log == 2*state%instant%cycle, "every cycle has its records")
      call tally%near(work%arcs, 3.0_wp*state%instant%cycle, 0.0_wp, "and its work")
      right = .true.
      do i = 1, state%instant%cycle
        right = right .and. cycles(1, i) == i - 1 .and. all(cycles(2:, i) == mod(i, length)) &
            .and. all(log(1, 2*i - 1:2*i) == [1, 2]) .and. all(log(2, 2*i - 1:2*i) == i - 1) &
            .and. all(log(5, 2*i - 1:2*i) == mod(i, length))
      end do
      call tally%is_true(right, "the records are those of the cycles")
      call tally%is_true(state%instant%y(1) == mod(state%instant%cycle, length), "so is the state")
    end do
  end subroutine test_rounds

  !> Records that have no room are counted and not written.
  subroutine test_short_records()
    type(recorder_t) :: recorder
    type(hybrid_state_t) :: state
    type(work_t) :: work
    recorder = new_recorder(31, 20, .false.)
    call go_round(3, 150, recorder, state, work, 0.0_wp)
    call tally%is_true(recorder%sums%n_log == 2*state%instant%cycle, "all lines are counted")
    call tally%is_true(recorder%sums%n_cycles == state%instant%cycle, "so are cycles")
    call tally%is_true(log(2, 31) == 15 .and. all(log(:, 32:) < 0), "the log ends where it is full")
    call tally%is_true(cycles(1, 20) == 19 .and. all(cycles(:, 21:) < 0), "so do the statistics")
  end subroutine test_short_records

  !> Where a full log stops the run, room for one more arc stays free.
  subroutine test_log_that_waits()
    type(recorder_t) :: recorder
    type(hybrid_state_t) :: state
    type(work_t) :: work
    recorder = new_recorder(room, room, .true.)
    call go_round(1, 1000000, recorder, state, work, 0.0_wp)
    call tally%is_true(recorder%sums%n_log <= room - log_reserve, "no line too many")
    call tally%is_true(recorder%sums%n_log > room - log_reserve - 2, "no line too few")
  end subroutine test_log_that_waits

  !> A sample of the history is not passed over.
  subroutine test_sample()
    type(recorder_t) :: recorder
    type(hybrid_state_t) :: state
    type(work_t) :: work
    recorder = new_recorder(room, room, .false.)
    sample_time(:, 1) = [40.0_wp, 0.0_wp]
    recorder%samples => samples
    recorder%sample_time => sample_time
    call go_round(1, 150, recorder, state, work, 0.0_wp)
    call tally%is_true(state%instant%cycle == 40, "up to the sample's cycle")
  end subroutine test_sample

  !> A motion that does not come back is left alone.
  subroutine test_no_return()
    type(recorder_t) :: recorder
    type(hybrid_state_t) :: state
    type(work_t) :: work
    recorder = new_recorder(room, room, .false.)
    call go_round(1000, 5000, recorder, state, work, 0.0_wp)
    call tally%is_true(state%instant%cycle == 100, "no round")
  end subroutine test_no_return

  !> Nor is one whose state comes back while a sum under way does not.
  subroutine test_other_sums()
    type(recorder_t) :: recorder
    type(hybrid_state_t) :: state
    type(work_t) :: work
    recorder = new_recorder(room, room, .false.)
    call go_round(2, 5000, recorder, state, work, 1.0e-9_wp)
    call tally%is_true(state%instant%cycle == 100, "no round")
  end subroutine test_other_sums
end program test_repetition
