!> Many operating points, in lines that run side by side.
!>
!> A line is a row of points done one after the other: each from rest, or each from where the one
!> before ended. What a line does depends on nothing outside it, so that the number of threads,
!> and where a call is cut, changes no bit of any result.
module lapwing_run_sweep
  use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
  use lapwing_kinds, only: wp, int64
  use lapwing_codes, only: separation, status_ok, status_unfinished, status_out_of_memory
  use lapwing_flow, only: flow_t, work_t
  use lapwing_hybrid_state, only: hybrid_state_t, numerics_t
  use lapwing_run_method, only: make_system, make_flow
  use lapwing_system_oscillator, only: oscillator_t
  use lapwing_system_parameters, only: parameters_t
  use lapwing_observers_averages, only: average_columns, averages_of
  use lapwing_observers_deviations, only: deviations_of
  use lapwing_observers_motion_class, only: motion_class, class_columns
  use lapwing_observers_records, only: recorder_t, start_recording, start_watching
  use lapwing_run, only: run_to, past, deadline_after
  use lapwing_system_start, only: start_of_run
  use lapwing_run_checkpoint, only: pack_blob, unpack_blob, pack_work, work_size
  implicit none
  private
  public :: sweep_t, line_t, curve_t, sweep_lines, stage_done, outcome_columns

  ! Stages of the point under way, and of a line that is done. The last settling cycle has its own.
  integer, parameter :: stage_start = 0, stage_settle = 1, stage_prepare = 2, stage_record = 3
  integer, parameter :: stage_done = 4

  !> Status, lines of the log, motion state, phi, phi' at the end, class, fastest arrival, averages
  !> over a period (over all recorded cycles without one), counts of work.
  integer, parameter :: outcome_columns = 5 + class_columns + 1 + average_columns + work_size

  !> A transmission error: a table, a series, whose table has no pieces, or both.
  type :: curve_t
    real(wp), allocatable :: knots(:)             !! (n + 1) mesh phase
    real(wp), allocatable :: coefficients(:, :)   !! (0:5, n) rad per period**k
    logical, allocatable :: kinks(:)              !! (n) slope jump at knots(i)
    real(wp), allocatable :: series(:, :)         !! (3, terms), order -1: none
  end type curve_t

  !> What every point of a sweep has in common, and where results go.
  type :: sweep_t
    type(parameters_t), allocatable :: point(:)                    !! (n_points)
    type(curve_t), allocatable :: curve(:)                         !! point%curve is one of them
    type(numerics_t) :: numerics                                   !! tolerances and bounds
    type(recorder_t) :: recorder                                   !! what is wanted of each point
    integer :: settle = 0                                          !! cycles before recording
    integer :: record = 0                                          !! cycles recorded
    !> (columns, record, n_points), rows of cycles that a point did not reach are NaN when it is
    !> finished; one for all where the lines' rows are not wanted: then by one thread, which leaves
    !> no line but one in the middle of a point.
    real(wp), pointer, contiguous :: cycles(:, :, :) => null()
    real(wp), pointer, contiguous :: tangent(:, :, :) => null()    !! (columns, record, n_points)
    real(wp), pointer, contiguous :: log(:, :, :) => null()        !! (columns, room, n_points)
    real(wp), pointer, contiguous :: density(:, :) => null()       !! (bins + 2, n_points) or null
    real(wp), pointer, contiguous :: outcome(:, :) => null()       !! (outcome_columns, n_points)
  end type sweep_t

  !> A line and how far it is.
  type :: line_t
    integer :: first = 1          !! first point
    integer :: last = 1           !! last point
    logical :: carried = .false.  !! whether a point begins where the one before ended
    integer :: point = 1          !! point under way
    integer :: stage = 0          !! stage_*
    !> First point: -1 (rest) or motion state, phi, phi', and phase. Later points begin at the
    !> same phase: at rest, or as carried.
    real(wp) :: start(4) = [-1, 0, 0, 0]
  end type line_t

contains

  !> Go on with every line until it is done or the deadline has come.
  subroutine sweep_lines(sweep, lines, blobs, deadline, n_threads)
    type(sweep_t), intent(in) :: sweep               !! the sweep
    type(line_t), intent(inout) :: lines(:)          !! its lines
    real(wp), intent(inout) :: blobs(:, :)           !! (blob_size, n_lines) runs under way
    integer(int64), intent(in) :: deadline           !! clock count at which to stop
    integer, intent(in) :: n_threads                 !! threads
    !$omp parallel num_threads(n_threads) default(none) shared(sweep, lines, blobs, deadline)
    call share_lines(sweep, lines, blobs, deadline)
    !$omp end parallel
  end subroutine sweep_lines

  !> One thread's share of the lines. An oscillator serves the next point too where that differs in
  !> its force only.
  subroutine share_lines(sweep, lines, blobs, deadline)
    type(sweep_t), intent(in) :: sweep               !! the sweep
    type(line_t), intent(inout) :: lines(:)          !! its lines
    real(wp), intent(inout) :: blobs(:, :)           !! (blob_size, n_lines) runs under way
    integer(int64), intent(in) :: deadline           !! clock count at which to stop
    class(oscillator_t), allocatable, target :: system
    class(flow_t), allocatable, target :: flow
    type(parameters_t) :: made   ! point that they were made for
    logical :: stopped   ! at the deadline: then no other line is begun
    integer(int64) :: until
    integer :: i
    stopped = .false.
    until = deadline
    !$omp do schedule(dynamic, 1)
    do i = 1, size(lines)
      if (stopped .or. lines(i)%stage == stage_done) cycle
      call go_on(sweep, lines(i), blobs(:, i), until, system, flow, made)
      stopped = lines(i)%stage < stage_done
    end do
    !$omp end do
  end subroutine share_lines

  !> Go on with one line.
  subroutine go_on(sweep, line, blob, until, system, flow, made)
    type(sweep_t), intent(in) :: sweep               !! the sweep
    type(line_t), intent(inout) :: line              !! the line
    real(wp), intent(inout) :: blob(:)               !! run under way
    integer(int64), intent(inout) :: until           !! clock count at which to stop; later, once
                                                     !! a first point was made
    class(oscillator_t), allocatable, intent(inout), target :: system   !! made, or made new, for
                                                                        !! each point
    class(flow_t), allocatable, intent(inout), target :: flow  !! and its way to move; none yet: not
                                                               !! made
    type(parameters_t), intent(inout) :: made        !! point that they were made for
    type(hybrid_state_t) :: state
    type(recorder_t) :: recorder
    type(work_t) :: work
    real(wp) :: final(3, 1)
    integer :: status, error
    integer(int64) :: begun
    logical :: first
    do while (line%stage < stage_done)
      ! To make a point is most of the work where a table has very many pieces. Beyond a thread's
      ! first none is made that would be left at once; the first has time to be worth it.
      if (allocated(flow) .and. line%stage == stage_start) then
        if (past(until)) return
      end if
      first = .not. allocated(flow)
      call system_clock(begun)
      call make_point(sweep, sweep%point(line%point), system, flow, made, error)
      if (error /= 0) then
        call give_up(sweep, line)
        return
      end if
      if (first) until = max(until, deadline_after(begun, 0.0_wp))
      recorder = sweep%recorder
      if (line%stage == stage_start) then
        call start_point(system, line, blob, state)
        work = work_t()
        line%stage = stage_settle
      else
        call unpack_blob(blob, state, recorder%sums, work)
      end if
      call run_point(sweep, system, flow, line, until, state, recorder, work, status, final)
      if (status == status_unfinished) then
        call pack_blob(state, recorder%sums, work, blob)
        return
      end if
      call finish_point(sweep, line, final(:, 1), recorder, work, status, blob)
    end do
  end subroutine go_on

  !> The oscillator of a point and its way to move: made, or those before under another force.
  subroutine make_point(sweep, point, system, flow, made, error)
    type(sweep_t), intent(in) :: sweep                         !! the sweep
    type(parameters_t), intent(in) :: point                    !! the point's parameters
    class(oscillator_t), allocatable, intent(inout), target :: system   !! another's; then its own
    class(flow_t), allocatable, intent(inout), target :: flow  !! the same
    type(parameters_t), intent(inout) :: made                  !! point that they were made for
    integer, intent(out) :: error                              !! 0, or there is no memory for them
    error = 0
    if (allocated(flow)) then
      if (differ_in_force_only(made, point)) then
        call system%change_force(point)
        call flow%change_force(point%force)
        return
      end if
      deallocate (flow)
    end if
    made = point
    associate (curve => sweep%curve(point%curve))
      call make_system(point, curve%knots, curve%coefficients, curve%kinks, curve%series, &
          system, error)
    end associate
    if (error == 0) call make_flow(sweep%numerics%method, system, flow, error)
    if (error /= 0 .and. allocated(flow)) deallocate (flow)
  end subroutine make_point

  !> There is no memory for a line: its points that are not finished stay so.
  subroutine give_up(sweep, line)
    type(sweep_t), intent(in) :: sweep               !! the sweep
    type(line_t), intent(inout) :: line              !! the line
    integer :: i
    do i = line%point, line%last, sign(1, line%last - line%first)
      sweep%outcome(1, i) = status_out_of_memory
    end do
    line%stage = stage_done
  end subroutine give_up

  !> Whether two points differ in nothing but their force.
  pure logical function differ_in_force_only(one, other) result(same)
    type(parameters_t), intent(in) :: one, other               !! parameters of two points
    same = one%mesh_frequency_ratio == other%mesh_frequency_ratio &
        .and. one%flank_scale == other%flank_scale &
        .and. one%peak_to_peak == other%peak_to_peak &
        .and. one%damping_ratio == other%damping_ratio &
        .and. one%restitution == other%restitution &
        .and. one%backlash == other%backlash .and. one%tolerance == other%tolerance &
        .and. one%curve == other%curve
  end function differ_in_force_only

  !> Where a point begins: the state the line carries, or rest.
  subroutine start_point(system, line, blob, state)
    class(oscillator_t), intent(in) :: system        !! the point's oscillator
    type(line_t), intent(in) :: line                 !! the line
    real(wp), intent(in) :: blob(:)                  !! carried: -1 or motion state, phi, phi'
    type(hybrid_state_t), intent(out) :: state       !! state to begin with
    real(wp) :: begin(4)
    begin = line%start
    if (line%carried .and. line%point /= line%first) begin(:3) = blob(1:3)
    state%instant = start_of_run(system, begin)
  end subroutine start_point

  !> Settle, then record. A flight under way when recording begins counts whole: the statistics
  !> run through the last settling cycle too, and its line is dropped.
  subroutine run_point(sweep, system, flow, line, deadline, state, recorder, work, status, final)
    type(sweep_t), intent(in) :: sweep               !! the sweep
    class(oscillator_t), intent(in) :: system        !! the point's oscillator
    class(flow_t), intent(in) :: flow                !! how it moves
    type(line_t), intent(inout) :: line              !! the line
    integer(int64), intent(in) :: deadline           !! clock count at which to stop
    type(hybrid_state_t), intent(inout) :: state     !! state
    type(recorder_t), intent(inout) :: recorder      !! recorder, its sums under way
    type(work_t), intent(inout) :: work              !! counts
    integer, intent(out) :: status                   !! status_*
    real(wp), intent(out), target :: final(3, 1)     !! motion state, phi, phi' at the end
    real(wp) :: target_t
    real(wp), target :: final_time(2, 1)
    status = status_ok
    final = 0
    target_t = line%start(4)*system%period
    if (line%stage == stage_settle) then
      if (sweep%settle > 1) call settle(sweep, system, flow, target_t, deadline, state, work, &
          status)
      if (status /= status_ok) return
      line%stage = stage_prepare
      if (sweep%settle > 1) call start_watching(recorder, &
          state%instant%motion_state == separation)
    end if
    call point_at_output(sweep, system, line, recorder)
    if (line%stage == stage_prepare) then
      recorder%want_impacts = .false.
      call run_to(system, flow, sweep%numerics, sweep%settle, target_t, deadline, state, recorder, &
          work, status)
      if (status /= status_ok) return
      if (sweep%settle > 0) call start_recording(recorder)
      recorder%want_impacts = sweep%recorder%want_impacts
      line%stage = stage_record
    end if
    if (associated(sweep%density)) recorder%density%counts => sweep%density(:, line%point)
    final_time(:, 1) = [real(sweep%settle + sweep%record, wp), target_t]
    recorder%sample_time => final_time
    recorder%samples => final
    recorder%sums%next_sample = 1
    call run_to(system, flow, sweep%numerics, sweep%settle + sweep%record, target_t, deadline, &
        state, recorder, work, status)
    nullify (recorder%sample_time, recorder%samples)
  end subroutine run_point

  !> The cycles of which nothing is recorded: all but one before recording.
  subroutine settle(sweep, system, flow, target_t, deadline, state, work, status)
    type(sweep_t), intent(in) :: sweep               !! the sweep
    class(oscillator_t), intent(in) :: system        !! the point's oscillator
    class(flow_t), intent(in) :: flow                !! how it moves
    real(wp), intent(in) :: target_t                 !! time in a cycle at which recording begins
    integer(int64), intent(in) :: deadline           !! clock count at which to stop
    type(hybrid_state_t), intent(inout) :: state     !! state
    type(work_t), intent(inout) :: work              !! counts
    integer, intent(out) :: status                   !! status_*
    type(recorder_t) :: silent
    call run_to(system, flow, sweep%numerics, max(sweep%settle - 1, 0), target_t, deadline, state, &
        silent, work, status)
  end subroutine settle

  !> Let a recorder write where the point's results go.
  subroutine point_at_output(sweep, system, line, recorder)
    type(sweep_t), intent(in) :: sweep               !! the sweep
    class(oscillator_t), intent(in) :: system        !! the point's oscillator
    type(line_t), intent(in) :: line                 !! the line
    type(recorder_t), intent(inout) :: recorder      !! recorder
    recorder%cycles => sweep%cycles(:, :, min(line%point, size(sweep%cycles, 3)))
    recorder%log => sweep%log(:, :, line%point)
    if (recorder%want_tangent) recorder%tangent => sweep%tangent(:, :, line%point)
    if (recorder%want_tangent .or. recorder%want_averages) then
      recorder%deviations = deviations_of(system)
    end if
  end subroutine point_at_output

  !> Write a point's outcome, and make the next one ready.
  subroutine finish_point(sweep, line, final, recorder, work, status, blob)
    type(sweep_t), intent(in) :: sweep               !! the sweep
    type(line_t), intent(inout) :: line              !! the line
    real(wp), intent(in) :: final(3)                 !! motion state, phi, phi' at the end
    type(recorder_t), intent(in) :: recorder         !! recorder
    type(work_t), intent(in) :: work                 !! counts
    integer, intent(in) :: status                    !! status_*
    real(wp), intent(inout) :: blob(:)               !! carried to the next point
    real(wp) :: found(class_columns), averages(average_columns)
    integer :: recorded, first
    recorded = 0
    if (line%stage == stage_record) recorded = recorder%sums%n_cycles
    associate (rest => sweep%cycles(:, recorded + 1:, min(line%point, size(sweep%cycles, 3))))
      rest = ieee_value(rest, ieee_quiet_nan)
    end associate
    found = 0
    averages = 0
    if (status == status_ok .and. recorder%want_cycles) then
      associate (point => sweep%point(line%point))
        found = motion_class(recorder%cycles, point%force, point%backlash, point%contact_law)
      end associate
      if (recorder%want_averages) then
        first = merge(sweep%record - nint(found(1)) + 1, 1, found(1) > 0)
        averages = averages_of(recorder%cycles(size(recorder%cycles, 1) - average_columns + 1:, &
            first:))
      end if
    end if
    sweep%outcome(:, line%point) = [real(status, wp), real(recorder%sums%n_log, wp), final, &
        found, recorder%sums%fastest, averages, pack_work(work)]
    if (line%carried) then
      blob(1:3) = final
      if (status /= status_ok) blob(1) = -1
    end if
    line%stage = stage_start
    if (line%point == line%last) then
      line%stage = stage_done
    else
      line%point = line%point + sign(1, line%last - line%first)
    end if
  end subroutine finish_point
end module lapwing_run_sweep
