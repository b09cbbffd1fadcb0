!> One trajectory from where it is to a target, recorded.
module lapwing_run
  use lapwing_kinds, only: wp, int64
  use lapwing_hybrid_automaton, only: advance
  use lapwing_codes, only: status_ok, status_unfinished, status_step_too_small, status_not_finite
  use lapwing_flow, only: flow_t, work_t
  use lapwing_hybrid_state, only: hybrid_state_t, numerics_t, segment_t
  use lapwing_observers_recorder, only: record_segment, sample_at, look_ahead, &
      looks_closely, write_unfinished
  use lapwing_observers_records, only: recorder_t, log_has_room
  use lapwing_run_cycle_detection, only: repetition_t, end_of_cycle
  use lapwing_system, only: system_t, instant_t
  implicit none
  private
  public :: run_to, deadline_in, deadline_after, past, segments_per_look

  !> Segments between two looks at the clock: some 30 microseconds.
  integer, parameter :: segments_per_look = 128
  !> What was made for a call, and goes with it, is used for so many times as long as that took.
  integer, parameter :: worth = 3

contains

  !> Advance until the target, the deadline has come, the log is full, or something has gone wrong.
  !> Everything that happens at the target's own instant belongs to the run.
  !>
  !> An arc that would pass the target is looked at (a sample there sees it) and taken back: the
  !> state stays where it began and nothing else of it is recorded. Going on repeats it bit for
  !> bit, so that where a run is cut changes nothing.
  subroutine run_to(system, flow, numerics, target_cycle, target_t, deadline, state, recorder, &
      work, status)
    class(system_t), intent(in) :: system            !! what moves
    class(flow_t), intent(in) :: flow                !! how
    type(numerics_t), intent(in) :: numerics         !! tolerances and bounds
    integer, intent(in) :: target_cycle              !! cycle of the target
    real(wp), intent(in) :: target_t                 !! time in it
    integer(int64), intent(in) :: deadline           !! clock count at which to stop
    type(hybrid_state_t), intent(inout) :: state     !! state, moved on
    type(recorder_t), intent(inout) :: recorder      !! what is recorded
    type(work_t), intent(inout) :: work              !! counts
    integer, intent(out) :: status                   !! status_*
    type(segment_t) :: segment
    type(hybrid_state_t) :: before
    type(work_t) :: work_before
    type(repetition_t) :: repetition
    integer :: looks, seen_until
    logical :: may_be_taken_back
    status = status_ok
    looks = 0
    seen_until = -1
    do while (.not. passed(state%instant, target_cycle, target_t))
      looks = looks + 1
      if (.not. log_has_room(recorder)) status = status_unfinished
      if (looks == segments_per_look) then
        if (past(deadline)) status = status_unfinished
        looks = 0
      end if
      if (status /= status_ok) return
      ! An arc ends with its cycle, at the latest. One in closed form that fails has moved nothing
      ! but the instant.
      may_be_taken_back = flow%takes_steps .or. state%instant%cycle >= target_cycle
      if (may_be_taken_back) then
        before = state
        work_before = work
      end if
      segment%unseen = flow%takes_steps .and. state%instant%cycle < target_cycle &
          .and. state%instant%cycle > seen_until
      if (segment%unseen) segment%unseen = .not. looks_closely(recorder, state%instant)
      call advance(system, flow, numerics, state, segment, work, status)
      if (status == status_step_too_small .or. status == status_not_finite) then
        if (may_be_taken_back) then
          state = before
        else
          state%instant = segment%begin
        end if
        if (segment%skipped > 0) then
          ! Once more step by step, up to the one that fails.
          work = work_before
          status = status_ok
          seen_until = state%instant%cycle
          cycle
        end if
        call write_unfinished(recorder, system, flow, segment, 0.0_wp)
        return
      end if
      if (passed(state%instant, target_cycle, target_t)) then
        state = before
        work = work_before
        status = status_ok
        call look_ahead(recorder, system, flow, segment, target_t, work)
        call write_unfinished(recorder, system, flow, segment, target_t)
        exit
      end if
      call record_segment(recorder, system, flow, segment, state%instant, work)
      if (status /= status_ok) then
        call write_unfinished(recorder, system, flow, segment, 0.0_wp)
        return
      end if
      if (segment%cycle_completed .and. numerics%copy_repeats) then
        call end_of_cycle(repetition, target_cycle, state, recorder, work)
      end if
    end do
    if (associated(recorder%samples)) then
      call sample_end(recorder, system, state%instant, work)
    end if
  end subroutine run_to

  !> A last sample exactly where the run ends belongs to no arc.
  subroutine sample_end(recorder, system, instant, work)
    type(recorder_t), intent(inout) :: recorder      !! what is recorded
    class(system_t), intent(in) :: system            !! what moves
    type(instant_t), intent(in) :: instant           !! where the run ends
    type(work_t), intent(inout) :: work              !! counts
    do while (recorder%sums%next_sample <= size(recorder%samples, 2))
      associate (time => recorder%sample_time(:, recorder%sums%next_sample))
        if (nint(time(1)) /= instant%cycle .or. time(2) > instant%t) return
      end associate
      call sample_at(recorder, system, instant, work)
    end do
  end subroutine sample_end

  !> Whether a target lies behind.
  pure logical function passed(instant, target_cycle, target_t)
    type(instant_t), intent(in) :: instant           !! where the system is
    integer, intent(in) :: target_cycle              !! cycle of the target
    real(wp), intent(in) :: target_t                 !! time in it
    passed = instant%cycle > target_cycle &
        .or. (instant%cycle == target_cycle .and. instant%t > target_t)
  end function passed

  !> Clock count so many seconds from now.
  integer(int64) function deadline_in(seconds)
    real(wp), intent(in) :: seconds                  !! seconds
    integer(int64) :: now, rate
    call system_clock(now, rate)
    deadline_in = now + int(seconds*rate, int64)
  end function deadline_in

  !> The same, or later where to make what moves took long: since a clock count.
  integer(int64) function deadline_after(begun, seconds)
    integer(int64), intent(in) :: begun              !! clock count
    real(wp), intent(in) :: seconds                  !! seconds
    integer(int64) :: now
    call system_clock(now)
    deadline_after = max(deadline_in(seconds), now + worth*(now - begun))
  end function deadline_after

  !> Whether the clock has come to a deadline.
  logical function past(deadline)
    integer(int64), intent(in) :: deadline           !! clock count
    integer(int64) :: now
    call system_clock(now)
    past = now >= deadline
  end function past
end module lapwing_run
