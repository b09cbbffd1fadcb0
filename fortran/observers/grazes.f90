!> Near-grazes: where a segment comes near a flank, or near release, and turns back.
module lapwing_observers_grazes
  use lapwing_kinds, only: wp
  use lapwing_codes, only: separation, event_near_graze, event_kind
  use lapwing_flow_rk4_crossing, only: work_t
  use lapwing_hybrid_state, only: segment_t, event_t, instant_in_segment
  use lapwing_polynomial_evaluation, only: max_degree, horner, upper_bound
  use lapwing_polynomial_roots, only: critical_points
  use lapwing_observers_records, only: recorder_t, log_line
  use lapwing_system, only: system_t, instant_t, frame_t
  implicit none
  private
  public :: find_grazes

contains

  !> Log where a segment comes near a flank, or near release, and turns back.
  subroutine find_grazes(self, system, segment, until, work)
    type(recorder_t), intent(inout) :: self
    class(system_t), intent(in) :: system        !! what moves
    type(segment_t), intent(in) :: segment       !! what happened
    real(wp), intent(in) :: until                !! time in the cycle: later ones wait
    type(work_t), intent(inout) :: work          !! counts
    type(frame_t) :: frame
    integer :: flank
    frame = segment%frame
    if (segment%closed) then
      do flank = 1, system%n_flanks
        if (segment%motion_state /= separation .and. segment%motion_state /= flank) cycle
        call grazes_in_closed_form(self, system, segment, flank, until, work)
      end do
      return
    end if
    do
      do flank = 1, system%n_flanks
        if (segment%motion_state /= separation .and. segment%motion_state /= flank) cycle
        call graze_on_piece(self, system, segment, frame, flank, until, work)
      end do
      if (frame%piece_end >= segment%length) return
      call system%next_piece(frame)
    end do
  end subroutine find_grazes

  !> Near-grazes of one flank on one piece.
  subroutine graze_on_piece(self, system, segment, frame, flank, until, work)
    type(recorder_t), intent(inout) :: self
    class(system_t), intent(in) :: system        !! what moves
    type(segment_t), intent(in) :: segment       !! what happened
    type(frame_t), intent(in) :: frame           !! frame on the piece
    integer, intent(in) :: flank                 !! flank
    real(wp), intent(in) :: until                !! time in the cycle: later ones wait
    type(work_t), intent(inout) :: work          !! counts
    real(wp) :: c(0:max_degree), length, at(max_degree), distance
    type(instant_t) :: instant
    integer :: i, n
    length = min(frame%piece_end, segment%length) - frame%piece_begin
    call system%gap(frame, flank, segment%motion, c)
    if (segment%motion_state /= separation) c = -c
    if (-upper_bound(-c, length) > self%graze_distance) return
    work%graze_searches = work%graze_searches + 1
    call critical_points(c, length, n, at)
    do i = 1, n
      distance = horner(c, at(i))
      if (distance <= 0 .or. distance > self%graze_distance) cycle
      if (horner(c, at(i) - 1.0e-3_wp*length) < distance) cycle
      call instant_in_segment(system, segment, frame, frame%piece_begin + at(i), instant)
      call log_graze(self, system, segment, flank, instant, until)
    end do
  end subroutine graze_on_piece

  !> Near-grazes of one flank on a stretch in closed form.
  subroutine grazes_in_closed_form(self, system, segment, flank, until, work)
    type(recorder_t), intent(inout) :: self
    class(system_t), intent(in) :: system        !! what moves
    type(segment_t), intent(in) :: segment       !! what happened
    integer, intent(in) :: flank                 !! flank
    real(wp), intent(in) :: until                !! time in the cycle: later ones wait
    type(work_t), intent(inout) :: work          !! counts
    real(wp) :: from, s, distance, bend, inward
    type(instant_t) :: instant
    logical :: found
    work%graze_searches = work%graze_searches + 1
    inward = merge(1.0_wp, -1.0_wp, segment%motion_state == separation)
    from = 0
    do
      call system%turn(segment%begin, flank, from, segment%length, found, s, distance, bend)
      if (.not. found) return
      distance = inward*distance
      if (distance > 0 .and. distance <= self%graze_distance .and. inward*bend > 0) then
        call instant_in_segment(system, segment, segment%frame, s, instant)
        call log_graze(self, system, segment, flank, instant, until)
      end if
      from = s
    end do
  end subroutine grazes_in_closed_form

  !> Log a near-graze in the time asked about.
  subroutine log_graze(self, system, segment, flank, instant, until)
    type(recorder_t), intent(inout) :: self
    class(system_t), intent(in) :: system        !! what moves
    type(segment_t), intent(in) :: segment       !! what happened
    integer, intent(in) :: flank                 !! flank
    type(instant_t), intent(in) :: instant       !! where the distance turns
    real(wp), intent(in) :: until                !! time in the cycle: later ones wait
    type(event_t) :: event
    if (instant%t <= self%sums%grazes_known_to .or. instant%t > until) return
    event%kind = event_kind(event_near_graze, flank)
    event%cycle = segment%cycle
    event%t = instant%t
    call system%observe(instant, event%phi, event%before)
    event%after = event%before
    call log_line(self, event)
  end subroutine log_graze
end module lapwing_observers_grazes
