!> Between the flat arrays of the API and the engine's types.
module lapwing_api_marshal
  use, intrinsic :: iso_c_binding, only: c_double, c_int
  use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan, ieee_is_nan
  use lapwing_kinds, only: wp, int64
  use lapwing_codes, only: all_codes, separation, status_unfinished, status_out_of_memory
  use lapwing_flow, only: flow_t, work_t
  use lapwing_hybrid_state, only: hybrid_state_t, numerics_t
  use lapwing_run_method, only: make_system, make_flow
  use lapwing_system_oscillator, only: oscillator_t
  use lapwing_system_parameters, only: parameters_t
  use lapwing_polynomial_evaluation, only: max_degree
  use lapwing_observers_averages, only: average_columns
  use lapwing_observers_deviations, only: deviations_of
  use lapwing_observers_period, only: period_of, most_looked_for
  use lapwing_observers_records, only: recorder_t, start_recording, start_watching, log_columns, &
      cycle_columns, sample_columns
  use lapwing_run, only: run_to, deadline_in, deadline_after
  use lapwing_system_start, only: start_of_run
  use lapwing_run_checkpoint, only: blob_size, work_size, pack_blob, unpack_blob
  use lapwing_run_destination, only: known_t, follow_starts, goal_columns, end_columns, &
      suspended_size
  use lapwing_run_sweep, only: sweep_t, line_t, curve_t, sweep_lines, stage_done, &
      outcome_columns
  use lapwing_observers_tangent, only: tangent_columns
  use lapwing_flank, only: locate_piece
  use lapwing_flank_table, only: te_table_t, make_table, expand_at
  implicit none
  private
  public :: all_sizes, all_codes, evaluate, period_of_rows, go_on_with_trajectory
  public :: go_on_with_sweep, go_on_with_destinations

  !> force, Omega, flank scale, peak-to-peak of g, xi, epsilon, theta0, rtol, chatter tolerance,
  !> count depth, graze distance, slowest and fastest impact binned, mean acceleration, which of
  !> the transmission errors (sweeps)
  integer, parameter :: n_reals = 15
  !> contact law, impact law, gap, back_flank_te, largest numbers of events and of steps in a
  !> cycle; events, impacts, grazes, strobe, cycles wanted; settling cycles, recorded cycles;
  !> method; tangent maps wanted; whether repeated cycles are copied; degrees of freedom; depths of
  !> flights wanted; whether bounces that do not count may be summed; averages wanted (sweeps)
  integer, parameter :: n_choices = 20

  integer(c_int), parameter :: all_sizes(14) = [blob_size, work_size, log_columns, cycle_columns, &
      sample_columns, n_reals, n_choices, tangent_columns, outcome_columns, most_looked_for, &
      goal_columns, end_columns, suspended_size, average_columns]

contains

  !> g, g' and g'' of a scaled table.
  subroutine evaluate(flank, scale, period, t, g)
    real(c_double), intent(in) :: flank(:, :)          !! see `api`
    real(c_double), intent(in) :: scale                !! g / transmission error
    real(c_double), intent(in) :: period               !! mesh period in tau
    real(c_double), intent(in) :: t(:)                 !! times
    real(c_double), intent(out) :: g(:, :)             !! (3, n)
    type(te_table_t) :: table
    type(curve_t) :: data
    real(wp) :: local(0:max_degree)
    integer :: i, error
    g = ieee_value(g, ieee_quiet_nan)
    call take_flank(flank, data, error)
    if (error == 0) call make_table(data%knots, data%coefficients, data%kinks, scale, period, &
        0.0_wp, table, error)
    if (error /= 0) return
    do i = 1, size(t)
      call expand_at(table, locate_piece(table, t(i), 1), t(i), local)
      g(:, i) = [local(0), local(1), 2*local(2)]
    end do
  end subroutine evaluate

  !> The transmission error in the engine's own arrays.
  subroutine take_flank(flank, data, error)
    real(c_double), intent(in) :: flank(:, :)          !! (8, columns), see `api`
    type(curve_t), intent(out) :: data            !! the same
    integer, intent(out) :: error                      !! 0, or there is no memory for it
    integer :: pieces, terms
    terms = count(flank(8, :) < 0)
    pieces = max(0, size(flank, 2) - terms - 1)
    allocate (data%knots(pieces + 1), stat=error)
    if (error == 0) allocate (data%coefficients(0:5, pieces), stat=error)
    if (error == 0) allocate (data%kinks(pieces), stat=error)
    if (error == 0) allocate (data%series(3, max(1, terms)), stat=error)
    if (error /= 0) return
    data%knots(:) = flank(1, :pieces + 1)
    data%coefficients(:, :) = flank(2:7, :pieces)
    data%kinks(:) = flank(8, :pieces) > 0
    data%series(:, 1) = [-1, 0, 0]
    if (terms > 0) data%series(:, :) = flank(1:3, size(flank, 2) - terms + 1:)
  end subroutine take_flank

  !> See `api`.
  pure integer function period_of_rows(cycles, scale, most) result(period)
    real(c_double), intent(in) :: cycles(:, :)         !! (2 + labels, n)
    real(c_double), intent(in) :: scale                !! size of the motion, rad
    integer(c_int), intent(in) :: most                 !! longest period looked for
    integer :: k
    period = period_of(cycles, 1, [(k, k=3, size(cycles, 1))], scale, most)
  end function period_of_rows

  pure function parameters_from(reals, choices) result(p)
    real(c_double), intent(in) :: reals(:)        !! (n_reals)
    integer(c_int), intent(in) :: choices(:)      !! (n_choices)
    type(parameters_t) :: p
    p%force = reals(1)
    p%mesh_frequency_ratio = reals(2)
    p%flank_scale = reals(3)
    p%peak_to_peak = reals(4)
    p%damping_ratio = reals(5)
    p%restitution = reals(6)
    p%backlash = reals(7)
    p%tolerance = reals(8)
    p%mean_acceleration = reals(14)
    p%curve = nint(reals(15))
    p%degrees_of_freedom = choices(17)
    p%contact_law = choices(1)
    p%impact_law = choices(2)
    p%gap = choices(3)
    p%back_flank_te = choices(4) == 1
  end function parameters_from

  pure function numerics_from(reals, choices) result(numerics)
    real(c_double), intent(in) :: reals(:)        !! (n_reals)
    integer(c_int), intent(in) :: choices(:)      !! (n_choices)
    type(numerics_t) :: numerics
    numerics%tolerance = reals(8)
    numerics%chatter_tolerance = reals(9)
    numerics%max_events_per_cycle = choices(5)
    numerics%max_steps_per_cycle = choices(6)
    numerics%method = choices(14)
    numerics%copy_repeats = choices(16) == 1
    numerics%sum_early = choices(19) == 1
    numerics%count_depth = reals(10)
  end function numerics_from

  function recorder_from(reals, choices) result(recorder)
    real(c_double), intent(in) :: reals(:)        !! (n_reals)
    integer(c_int), intent(in) :: choices(:)      !! (n_choices)
    type(recorder_t) :: recorder
    recorder%count_depth = reals(10)
    recorder%graze_distance = reals(11)
    recorder%density%low = reals(12)
    recorder%density%high = reals(13)
    recorder%want_events = choices(7) == 1
    recorder%want_impacts = choices(8) == 1
    recorder%want_grazes = choices(9) == 1
    recorder%want_strobe = choices(10) == 1
    recorder%want_cycles = choices(11) == 1
    recorder%want_tangent = choices(15) == 1
    recorder%want_depths = choices(18) == 1
  end function recorder_from

  !> See `api`.
  subroutine go_on_with_trajectory(flank, reals, choices, start, until, blob, sample_time, &
      samples, log, cycles, tangent, done)
    real(c_double), intent(in) :: flank(:, :)                       !! see `api`
    real(c_double), intent(in) :: reals(:)                          !! (n_reals)
    integer(c_int), intent(in) :: choices(:)                        !! (n_choices)
    real(c_double), intent(in) :: start(4)                          !! how to begin
    real(c_double), intent(in) :: until(3)                          !! cycle, time in it, seconds
    real(c_double), intent(inout) :: blob(:)                        !! run under way
    real(c_double), intent(in), target, contiguous :: sample_time(:, :)     !! (2, n)
    real(c_double), intent(inout), target, contiguous :: samples(:, :)      !! see `api`
    real(c_double), intent(inout), target, contiguous :: log(:, :)          !! see `api`
    real(c_double), intent(inout), target, contiguous :: cycles(:, :)       !! see `api`
    real(c_double), intent(inout), target, contiguous :: tangent(:, :)      !! see `api`
    real(c_double), intent(out) :: done(9)                          !! how far it came
    class(oscillator_t), allocatable, target :: system
    class(flow_t), allocatable, target :: flow
    type(curve_t) :: data
    type(numerics_t) :: numerics
    type(hybrid_state_t) :: state
    type(recorder_t) :: recorder
    type(work_t) :: work
    real(wp) :: phi, phi_dot
    integer :: status, error
    integer(int64) :: begun
    call system_clock(begun)
    numerics = numerics_from(reals, choices)
    done = 0
    call take_flank(flank, data, error)
    if (error == 0) call make_system(parameters_from(reals, choices), data%knots, &
        data%coefficients, data%kinks, data%series, system, error)
    if (error == 0) call make_flow(numerics%method, system, flow, error)
    if (error /= 0) then
      done(1) = status_out_of_memory
      return
    end if
    recorder = recorder_from(reals, choices)
    recorder%want_unfinished = recorder%want_cycles
    if (start(1) > -1.5_wp) then
      call start_watching(recorder, in_flight=.false.)
      state%instant = start_of_run(system, start)
    else
      call unpack_blob(blob, state, recorder%sums, work)
      call start_recording(recorder)
      call start_watching(recorder, state%instant%motion_state == separation)
    end if
    recorder%log => log
    recorder%cycles => cycles
    recorder%tangent => tangent
    if (recorder%want_tangent) recorder%deviations = deviations_of(system)
    ! f2py passes no empty array: a single sample before the first cycle means none.
    if (sample_time(1, 1) >= 0) then
      recorder%sample_time => sample_time
      recorder%samples => samples
    end if
    call run_to(system, flow, numerics, nint(until(1)), until(2), &
        deadline_after(begun, until(3)), state, recorder, work, status)
    call pack_blob(state, recorder%sums, work, blob)
    call system%observe(state%instant, phi, phi_dot)
    done = [real([status, recorder%sums%n_log, recorder%sums%n_cycles, state%instant%cycle], wp), &
        state%instant%t, real(state%instant%motion_state, wp), phi, phi_dot, &
        merge(1.0_wp, 0.0_wp, recorder%unfinished)]
  end subroutine go_on_with_trajectory

  !> See `api`.
  subroutine go_on_with_sweep(flank, reals, choices, lines, starts, within, blobs, cycles, &
      tangent, density, log, outcome)
    real(c_double), intent(in) :: flank(:, :, :)                    !! see `api`
    real(c_double), intent(in) :: reals(:, :)                       !! (n_reals, n_points)
    integer(c_int), intent(in) :: choices(:)                        !! (n_choices)
    integer(c_int), intent(inout) :: lines(:, :)                    !! (5, n_lines)
    real(c_double), intent(in) :: starts(:, :)                      !! (4, n_lines)
    real(c_double), intent(in) :: within(2)                         !! seconds, threads
    real(c_double), intent(inout) :: blobs(:, :)                    !! runs under way
    real(c_double), intent(inout), target, contiguous :: cycles(:, :, :)   !! see `api`
    real(c_double), intent(inout), target, contiguous :: tangent(:, :, :)  !! see `api`
    real(c_double), intent(inout), target, contiguous :: density(:, :)     !! (bins, points) or 1
    real(c_double), intent(inout), target, contiguous :: log(:, :, :)      !! see `api`
    real(c_double), intent(inout), target, contiguous :: outcome(:, :)     !! (columns, points)
    type(sweep_t) :: sweep
    type(line_t), allocatable :: line(:)
    integer :: i, error
    allocate (sweep%point(size(reals, 2)), stat=error)
    if (error == 0) allocate (line(size(lines, 2)), stat=error)
    if (error == 0) allocate (sweep%curve(size(flank, 3)), stat=error)
    if (error == 0) then
      do i = 1, size(flank, 3)
        call take_flank(flank(:, :count(.not. ieee_is_nan(flank(1, :, i))), i), sweep%curve(i), &
            error)
        if (error /= 0) exit
      end do
    end if
    if (error /= 0) then
      where (outcome(1, :) == status_unfinished) outcome(1, :) = status_out_of_memory
      lines(5, :) = stage_done
      return
    end if
    do i = 1, size(reals, 2)
      sweep%point(i) = parameters_from(reals(:, i), choices)
    end do
    sweep%numerics = numerics_from(reals(:, 1), choices)
    sweep%recorder = recorder_from(reals(:, 1), choices)
    sweep%recorder%want_averages = choices(20) == 1
    sweep%settle = choices(12)
    sweep%record = choices(13)
    sweep%cycles => cycles
    sweep%tangent => tangent
    if (size(density, 1) > 1) sweep%density => density
    sweep%log => log
    sweep%outcome => outcome
    do i = 1, size(line)
      line(i) = line_t(lines(1, i), lines(2, i), lines(3, i) == 1, lines(4, i), lines(5, i), &
          starts(:, i))
    end do
    call sweep_lines(sweep, line, blobs, deadline_in(within(1)), nint(within(2)))
    do i = 1, size(line)
      lines(4:5, i) = [line(i)%point, line(i)%stage]
    end do
  end subroutine go_on_with_sweep

  !> See `api`.
  subroutine go_on_with_destinations(flank, reals, choices, limits, goals, box, cells, starts, &
      seconds, suspended, ends)
    real(c_double), intent(in) :: flank(:, :)                       !! see `api`
    real(c_double), intent(in) :: reals(:)                          !! (n_reals)
    integer(c_int), intent(in) :: choices(:)                        !! (n_choices)
    integer(c_int), intent(in) :: limits(3)                         !! cycles, returns, recurrences
    real(c_double), intent(in), target, contiguous :: goals(:, :)   !! see `destination`
    real(c_double), intent(in) :: box(4)                            !! that cells span
    integer(c_int), intent(in), target, contiguous :: cells(:, :)   !! see `destination`
    real(c_double), intent(in) :: starts(:, :)                      !! (4, n)
    real(c_double), intent(in) :: seconds                           !! for this call
    real(c_double), intent(inout) :: suspended(:)                   !! see `destination`
    real(c_double), intent(inout) :: ends(:, :)                     !! (end_columns, n)
    class(oscillator_t), allocatable, target :: system
    class(flow_t), allocatable, target :: flow
    type(curve_t) :: data
    type(numerics_t) :: numerics
    type(known_t) :: known
    integer :: error
    integer(int64) :: begun
    call system_clock(begun)
    numerics = numerics_from(reals, choices)
    call take_flank(flank, data, error)
    if (error == 0) call make_system(parameters_from(reals, choices), data%knots, &
        data%coefficients, data%kinks, data%series, system, error)
    if (error == 0) call make_flow(numerics%method, system, flow, error)
    if (error /= 0) then
      ends(1, nint(suspended(1)):) = status_out_of_memory
      suspended(:2) = [size(starts, 2) + 1, 0]
      return
    end if
    known = known_t(goals, cells, box, limits(1), limits(2), limits(3))
    call follow_starts(system, flow, numerics, known, starts, deadline_after(begun, seconds), &
        suspended, ends)
  end subroutine go_on_with_destinations
end module lapwing_api_marshal
