!> Cycles that repeat themselves to the last bit, written again instead of computed again.
!>
!> A cycle depends on the state it begins with and on nothing else. A run that begins a cycle with
!> the bits of an earlier one therefore goes round for ever: most periodic motions do after some
!> tens of cycles, where their transient has sunk below the last bit. Where one round has begun and
!> ended with the same `pack_blob`, that is, with the same bits of everything that decides how a
!> run goes on, its records are those of all rounds that follow, with other numbers of cycles.
module lapwing_run_cycle_detection
  use lapwing_kinds, only: wp
  use lapwing_flow, only: work_t
  use lapwing_hybrid_state, only: hybrid_state_t
  use lapwing_observers_records, only: recorder_t, log_reserve, waits_for_room
  use lapwing_run_checkpoint, only: blob_size, pack_blob, pack_work, unpack_work, go_on_alike
  use lapwing_system, only: instant_t
  implicit none
  private
  public :: repetition_t, end_of_cycle

  integer, parameter :: log_cycle = 2     !! row of the log that holds the cycle's number
  integer, parameter :: cycles_cycle = 1  !! and of the statistics
  integer, parameter :: no_cycle = 0      !! tangent maps have none

  !> What is remembered of earlier cycles. An anchor is kept for 1, 2, 4, ... cycles, so that
  !> whatever the round's length, it is found (R. P. Brent, BIT 20 (1980) 176-184).
  type :: repetition_t
    type(instant_t) :: anchor                !! beginning of an earlier cycle
    integer :: span = 0                      !! cycles that the anchor is kept; 0: there is none
    integer :: round = 0                     !! cycles until the anchor came back; 0: not yet
    ! The beginning of the round that may be written again.
    real(wp), allocatable :: blob(:)         !! (blob_size) all that decides how the run goes on
    real(wp), allocatable :: counts(:)       !! (bins + 2) impacts by speed, where counted
    type(work_t) :: work                     !! counts of work
    integer :: cycle = 0                     !! its first cycle
    integer :: n_log = 0                     !! lines in the log
    integer :: n_cycles = 0                  !! cycles closed
    integer :: next_sample = 0               !! next sample of the history
  end type repetition_t

contains

  !> A cycle has begun: find out whether it is one known already, and go as far towards the target
  !> as whole rounds lead. The state then is at the beginning of a cycle not behind the target's.
  subroutine end_of_cycle(self, target_cycle, state, recorder, work)
    type(repetition_t), intent(inout) :: self
    integer, intent(in) :: target_cycle              !! cycle of the target
    type(hybrid_state_t), intent(inout) :: state     !! state at the beginning of a cycle
    type(recorder_t), intent(inout) :: recorder      !! what is recorded
    type(work_t), intent(inout) :: work              !! counts
    if (self%round > 0) then
      if (state%instant%cycle < self%cycle + self%round) return
      call close_round(self, target_cycle, state, recorder, work)
    else if (came_back(self, state%instant)) then
      self%round = state%instant%cycle - self%anchor%cycle
      call open_round(self, state, recorder, work)
    else if (state%instant%cycle >= self%anchor%cycle + self%span) then
      self%anchor = state%instant
      self%span = max(1, 2*self%span)
    end if
  end subroutine end_of_cycle

  !> Whether a cycle begins where the anchor did.
  pure logical function came_back(self, instant)
    type(repetition_t), intent(in) :: self
    type(instant_t), intent(in) :: instant           !! beginning of a cycle
    came_back = .false.
    if (self%span == 0 .or. instant%motion_state /= self%anchor%motion_state) return
    came_back = all(instant%y == self%anchor%y)
  end function came_back

  !> Note where a round begins.
  subroutine open_round(self, state, recorder, work)
    type(repetition_t), intent(inout) :: self
    type(hybrid_state_t), intent(in) :: state        !! state at its beginning
    type(recorder_t), intent(in) :: recorder         !! what is recorded
    type(work_t), intent(in) :: work                 !! counts
    integer :: error
    if (.not. allocated(self%blob)) allocate (self%blob(blob_size))
    call pack_blob(state, recorder%sums, work, self%blob)
    if (associated(recorder%density%counts)) then
      if (.not. allocated(self%counts)) then
        allocate (self%counts(size(recorder%density%counts)), stat=error)
        if (error /= 0) then
          ! Without room to remember the round is computed, not written again.
          self%round = 0
          return
        end if
      end if
      self%counts(:) = recorder%density%counts
    end if
    self%work = work
    self%cycle = state%instant%cycle
    self%n_log = recorder%sums%n_log
    self%n_cycles = recorder%sums%n_cycles
    self%next_sample = recorder%sums%next_sample
  end subroutine open_round

  !> A round has passed: if it came back in every bit, write it again as often as there is room.
  subroutine close_round(self, target_cycle, state, recorder, work)
    type(repetition_t), intent(inout) :: self
    integer, intent(in) :: target_cycle              !! cycle of the target
    type(hybrid_state_t), intent(inout) :: state     !! state at its end
    type(recorder_t), intent(inout) :: recorder      !! what is recorded
    type(work_t), intent(inout) :: work              !! counts
    real(wp) :: blob(blob_size)
    integer :: rounds
    call pack_blob(state, recorder%sums, work, blob)
    rounds = 0
    if (go_on_alike(self%blob, blob)) rounds = rounds_ahead(self, target_cycle, state, recorder)
    if (rounds > 0) call write_rounds(self, rounds, state, recorder, work)
    self%round = 0
    self%span = 0
    self%anchor%cycle = state%instant%cycle
  end subroutine close_round

  !> Rounds until the target, the next sample or the end of the log.
  pure integer function rounds_ahead(self, target_cycle, state, recorder) result(rounds)
    type(repetition_t), intent(in) :: self
    integer, intent(in) :: target_cycle              !! cycle of the target
    type(hybrid_state_t), intent(in) :: state        !! state at a round's end
    type(recorder_t), intent(in) :: recorder         !! what is recorded
    integer :: until, lines
    until = target_cycle
    associate (sums => recorder%sums)
      if (associated(recorder%samples)) then
        if (sums%next_sample <= size(recorder%samples, 2)) then
          until = min(until, nint(recorder%sample_time(1, sums%next_sample)))
        end if
      end if
      rounds = max(0, (until - state%instant%cycle)/self%round)
      if (sums%next_sample /= self%next_sample) rounds = 0
      lines = sums%n_log - self%n_log
      if (waits_for_room(recorder) .and. lines > 0) then
        rounds = min(rounds, max(0, size(recorder%log, 2) - log_reserve - sums%n_log)/lines)
      end if
    end associate
  end function rounds_ahead

  !> Write the last round so many times more.
  subroutine write_rounds(self, rounds, state, recorder, work)
    type(repetition_t), intent(in) :: self
    integer, intent(in) :: rounds                    !! how often
    type(hybrid_state_t), intent(inout) :: state     !! state: its cycle moves on
    type(recorder_t), intent(inout) :: recorder      !! what is recorded
    type(work_t), intent(inout) :: work              !! counts: those of the round again
    integer :: tangents, lines, closed
    associate (sums => recorder%sums)
      lines = sums%n_log - self%n_log
      closed = sums%n_cycles - self%n_cycles
      tangents = sums%n_cycles
      if (recorder%want_tangent) call repeat_rows(recorder%tangent, tangents, closed, rounds, &
          no_cycle, self%round)
      if (closed > 0) call repeat_rows(recorder%cycles, sums%n_cycles, closed, rounds, &
          cycles_cycle, self%round)
      if (lines > 0) call repeat_rows(recorder%log, sums%n_log, lines, rounds, log_cycle, &
          self%round)
    end associate
    if (associated(recorder%density%counts)) then
      associate (counts => recorder%density%counts)
        counts = counts + rounds*(counts - self%counts)
      end associate
    end if
    work = unpack_work(pack_work(work) + rounds*(pack_work(work) - pack_work(self%work)))
    state%instant%cycle = state%instant%cycle + rounds*self%round
  end subroutine write_rounds

  !> Append the last `n_last` rows so many times, as far as there is room; all are counted.
  pure subroutine repeat_rows(rows, n, n_last, times, cycle_row, round)
    real(wp), intent(inout) :: rows(:, :)            !! (columns, room)
    integer, intent(inout) :: n                      !! rows written, or dropped for want of room
    integer, intent(in) :: n_last                    !! rows of a round
    integer, intent(in) :: times                     !! how often
    integer, intent(in) :: cycle_row                 !! where a row has its cycle's number, or 0
    integer, intent(in) :: round                     !! cycles of a round
    integer :: i
    do i = n + 1, min(n + n_last*times, size(rows, 2))
      rows(:, i) = rows(:, i - n_last)
      if (cycle_row /= no_cycle) rows(cycle_row, i) = rows(cycle_row, i) + round
    end do
    n = n + n_last*times
  end subroutine repeat_rows
end module lapwing_run_cycle_detection
