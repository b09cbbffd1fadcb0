!> Follow one case in the engine's own working precision: a case on standard input, what happened
!> on standard output, every digit written. tests/reference/quadruple.py writes the one and reads
!> the other.
program follow_in_quadruple
  use lapwing_codes, only: method_exact, method_rk4, status_ok
  use lapwing_flow, only: flow_t, work_t
  use lapwing_hybrid_state, only: hybrid_state_t, numerics_t
  use lapwing_kinds, only: wp
  use lapwing_run_method, only: make_flow
  use lapwing_system_oscillator, only: oscillator_t, make_oscillator
  use lapwing_system_parameters, only: parameters_t
  use lapwing_observers_records, only: recorder_t, log_columns, cycle_columns
  use lapwing_run, only: run_to, deadline_in
  use lapwing_system_start, only: start_at_rest, start_from
  implicit none

  !> A tenth of a million seconds: a case ends by its cycles.
  real(wp), parameter :: patience = 1.0e5_wp

  type(parameters_t) :: parameters
  type(numerics_t) :: numerics
  real(wp), allocatable :: knots(:), coefficients(:, :), kinks(:), series(:, :)
  real(wp) :: start(4)
  integer :: cycles, event_room
  call read_case()
  call follow()

contains

  !> Parameters by name; the table: phase, six coefficients and 1 at a kink for each piece; the
  !> series behind it, if any: order, amplitude and shift of each term.
  subroutine read_case()
    real(wp) :: force, mesh_frequency_ratio, flank_scale, peak_to_peak, damping_ratio, &
        restitution, backlash, tolerance, chatter_tolerance
    integer :: contact_law, impact_law, gap, back_flank_te, method, pieces, terms, i
    namelist /case/ force, mesh_frequency_ratio, flank_scale, peak_to_peak, damping_ratio, &
        restitution, backlash, tolerance, chatter_tolerance, contact_law, impact_law, gap, &
        back_flank_te, method, start, cycles, event_room, pieces, terms
    method = method_rk4
    event_room = 100000
    terms = 0
    read (*, nml=case)
    allocate (knots(pieces + 1), coefficients(0:5, pieces), kinks(pieces))
    do i = 1, pieces
      read (*, *) knots(i), coefficients(:, i), kinks(i)
    end do
    knots(pieces + 1) = 1
    allocate (series(3, max(terms, 1)))
    series(:, 1) = [-1, 0, 0]
    do i = 1, terms
      read (*, *) series(:, i)
    end do
    parameters = parameters_t(force=force, mesh_frequency_ratio=mesh_frequency_ratio, &
        flank_scale=flank_scale, peak_to_peak=peak_to_peak, damping_ratio=damping_ratio, &
        restitution=restitution, backlash=backlash, tolerance=tolerance, &
        contact_law=contact_law, impact_law=impact_law, gap=gap, back_flank_te=back_flank_te == 1)
    numerics%method = method
    numerics%tolerance = tolerance
    numerics%chatter_tolerance = chatter_tolerance
    numerics%max_steps_per_cycle = huge(1)
  end subroutine read_case

  !> Run to the beginning of cycle number `cycles` and write events, states at cycles' beginnings,
  !> the state at the end and the status.
  subroutine follow()
    type(oscillator_t), target :: system
    class(flow_t), allocatable, target :: flow
    type(hybrid_state_t) :: state
    type(recorder_t) :: recorder
    type(work_t) :: work
    real(wp), target :: log(log_columns, event_room), rows(cycle_columns, cycles + 1)
    real(wp) :: phi, phi_dot
    integer :: status, error, i, pieces
    ! The closed form takes a series without its table, steps are taken over the table.
    pieces = size(kinks)
    if (numerics%method == method_exact .and. series(1, 1) >= 0) pieces = 0
    if (numerics%method /= method_exact) series(1, 1) = -1
    call make_oscillator(parameters, knots(:pieces + 1), coefficients(:, :pieces), &
        kinks(:pieces) == 1, series, system, error)
    if (error == 0) call make_flow(numerics%method, system, flow, error)
    if (error /= 0) error stop "no memory"
    state%instant = start_at_rest(system, start(4))
    if (start(1) >= 0) then
      state%instant = start_from(system, start(4), nint(start(1)), start(2), start(3))
    end if
    recorder%want_events = .true.
    recorder%want_cycles = .true.
    recorder%log => log
    recorder%cycles => rows
    call run_to(system, flow, numerics, cycles, 0.0_wp, deadline_in(patience), state, recorder, &
        work, status)
    if (status /= status_ok) write (*, *) "# a status other than 0 follows"
    write (*, "(a, es45.35e4)") "period", system%period
    do i = 1, recorder%sums%n_log
      write (*, "(a, 2i8, 4es45.35e4)") "event", nint(log(1, i)), nint(log(2, i)), log(3:6, i)
    end do
    do i = 1, recorder%sums%n_cycles
      write (*, "(a, 2i8, 3es45.35e4)") "cycle", nint(rows(1, i)), nint(rows(2, i)), rows(3:4, i), &
          rows(15, i)
    end do
    call system%observe(state%instant, phi, phi_dot)
    write (*, "(a, i4, 2i8, 3es45.35e4)") "final", status, state%instant%cycle, &
        state%instant%motion_state, state%instant%t, phi, phi_dot
  end subroutine follow
end program follow_in_quadruple
