!> What Python may call: the only file f2py reads. Flat, one procedure per operation; kinds are C
!> kinds, every array has an explicit shape, nothing is optional. Layouts: `lapwing.engine`.
module api
  use, intrinsic :: iso_c_binding, only: c_double, c_int
  implicit none
  private
  public :: sizes, trajectory, sweep, evaluate_table, code_values

contains

  !> Sizes of the arrays that Python allocates.
  subroutine sizes(n)
    use lapwing_api_marshal, only: all_sizes
    integer(c_int), intent(out) :: n(8)   !! blob, work; log, cycle, sample columns; reals, choices;
                                          !! tangent columns
    n = all_sizes
  end subroutine sizes

  !> Named codes in the order of `lapwing.codes`, for the test that both sides agree.
  subroutine code_values(values)
    use lapwing_api_marshal, only: all_codes
    integer(c_int), intent(out) :: values(34)   !! the codes
    values = all_codes
  end subroutine code_values

  !> g, g' and g'' of the scaled table at times of the mesh period.
  subroutine evaluate_table(n_pieces, knots, coefficients, kinks, scale, period, n, t, g)
    use lapwing_api_marshal, only: evaluate
    integer(c_int), intent(in) :: n_pieces                          !! pieces
    real(c_double), intent(in) :: knots(n_pieces + 1)               !! mesh phase
    real(c_double), intent(in) :: coefficients(6, n_pieces)         !! rad per period**k
    integer(c_int), intent(in) :: kinks(n_pieces)                   !! 1: slope jump
    real(c_double), intent(in) :: scale                             !! g / transmission error
    real(c_double), intent(in) :: period                            !! mesh period in tau
    integer(c_int), intent(in) :: n                                 !! times
    real(c_double), intent(in) :: t(n)                              !! times, 0 <= t < period
    real(c_double), intent(out) :: g(3, n)                          !! g, g', g''
    !f2py threadsafe
    call evaluate(knots, coefficients, kinks, scale, period, t, g)
  end subroutine evaluate_table

  !> Go on with one trajectory until its target, a full log or the deadline.
  subroutine trajectory(n_pieces, knots, coefficients, kinks, n_series, series, n_reals, reals, &
      n_choices, choices, n_more, start, target, seconds, n_blob, blob, n_samples, sample_time, &
      samples, n_log, log, n_cycles, cycles, n_tangent_columns, n_tangent, tangent, done)
    use lapwing_api_marshal, only: go_on_with_trajectory
    integer(c_int), intent(in) :: n_pieces                          !! table pieces
    real(c_double), intent(in) :: knots(n_pieces + 1)               !! mesh phase
    real(c_double), intent(in) :: coefficients(6, n_pieces)         !! rad per period**k
    integer(c_int), intent(in) :: kinks(n_pieces)                   !! 1: slope jump
    integer(c_int), intent(in) :: n_series                          !! terms of the series
    real(c_double), intent(in) :: series(3, n_series)               !! order, amplitude (rad),
                                                                    !! shift; order -1: none
    integer(c_int), intent(in) :: n_reals                           !! real parameters
    real(c_double), intent(in) :: reals(n_reals)                    !! real parameters
    integer(c_int), intent(in) :: n_choices                         !! integer parameters
    integer(c_int), intent(in) :: choices(n_choices)                !! integer parameters
    integer(c_int), intent(in) :: n_more                            !! states beside phi, phi'
    real(c_double), intent(in) :: start(4)                          !! -2 go on, -1 rest, or motion
                                                                    !! state; phi, phi', phase
    real(c_double), intent(in) :: target(2)                         !! cycle, time in it
    real(c_double), intent(in) :: seconds                           !! time for this call
    integer(c_int), intent(in) :: n_blob                            !! size of the blob
    real(c_double), intent(inout) :: blob(n_blob)                   !! run under way
    integer(c_int), intent(in) :: n_samples                         !! samples
    real(c_double), intent(in) :: sample_time(2, n_samples)         !! cycle, time; (-1, 0): none
    real(c_double), intent(inout) :: samples(3 + n_more, n_samples) !! motion state, phi, phi',
                                                                    !! the other states
    integer(c_int), intent(in) :: n_log                             !! room in the log
    real(c_double), intent(inout) :: log(6, n_log)                  !! events
    integer(c_int), intent(in) :: n_cycles                          !! room for cycles
    real(c_double), intent(inout) :: cycles(17 + n_more, n_cycles)  !! statistics by cycle
    integer(c_int), intent(in) :: n_tangent_columns                 !! numbers of one: 9 + states**2
    integer(c_int), intent(in) :: n_tangent                         !! room for tangent maps
    real(c_double), intent(inout) :: tangent(n_tangent_columns, n_tangent)   !! tangent maps
    real(c_double), intent(out) :: done(8)                          !! status, log lines, cycles,
                                                                    !! cycle, t, state, phi, phi'
    !f2py threadsafe
    call go_on_with_trajectory(knots, coefficients, kinks, series, reals, choices, start, &
        target, seconds, blob, sample_time, samples, log, cycles, tangent, done)
  end subroutine trajectory

  !> Go on with a sweep until it is done or the deadline has come.
  subroutine sweep(n_pieces, knots, coefficients, kinks, n_series, series, n_reals, n_points, &
      reals, n_choices, choices, n_more, n_lines, lines, starts, seconds, n_threads, n_blob, &
      blobs, n_record, cycles, n_tangent_columns, n_tangent, n_tangent_points, tangent, n_bins, &
      n_density_points, density, n_log, log, n_outcome, outcome)
    use lapwing_api_marshal, only: go_on_with_sweep
    integer(c_int), intent(in) :: n_pieces                          !! table pieces
    real(c_double), intent(in) :: knots(n_pieces + 1)               !! mesh phase
    real(c_double), intent(in) :: coefficients(6, n_pieces)         !! rad per period**k
    integer(c_int), intent(in) :: kinks(n_pieces)                   !! 1: slope jump
    integer(c_int), intent(in) :: n_series                          !! terms of the series
    real(c_double), intent(in) :: series(3, n_series)               !! order, amplitude (rad),
                                                                    !! shift; order -1: none
    integer(c_int), intent(in) :: n_reals                           !! real parameters
    integer(c_int), intent(in) :: n_points                          !! points
    real(c_double), intent(in) :: reals(n_reals, n_points)          !! real parameters by point
    integer(c_int), intent(in) :: n_choices                         !! integer parameters
    integer(c_int), intent(in) :: choices(n_choices)                !! integer parameters
    integer(c_int), intent(in) :: n_more                            !! states beside phi, phi'
    integer(c_int), intent(in) :: n_lines                           !! lines
    integer(c_int), intent(inout) :: lines(5, n_lines)              !! first, last, carried, point,
                                                                    !! stage
    real(c_double), intent(in) :: starts(4, n_lines)                !! -1 rest, or motion state;
                                                                    !! phi, phi', phase
    real(c_double), intent(in) :: seconds                           !! time for this call
    integer(c_int), intent(in) :: n_threads                         !! threads
    integer(c_int), intent(in) :: n_blob                            !! size of a blob
    real(c_double), intent(inout) :: blobs(n_blob, n_lines)         !! runs under way
    integer(c_int), intent(in) :: n_record                          !! cycles recorded
    real(c_double), intent(inout) :: cycles(17 + n_more, n_record, n_points) !! statistics by cycle
    integer(c_int), intent(in) :: n_tangent_columns                 !! numbers of one: 9 + states**2
    integer(c_int), intent(in) :: n_tangent                         !! cycles with a tangent map
    integer(c_int), intent(in) :: n_tangent_points                  !! points with them, or 1
    !> Tangent maps
    real(c_double), intent(inout) :: tangent(n_tangent_columns, n_tangent, n_tangent_points)
    integer(c_int), intent(in) :: n_bins                            !! bins of impact speeds, or 1
    integer(c_int), intent(in) :: n_density_points                  !! points with them, or 1
    real(c_double), intent(inout) :: density(n_bins, n_density_points) !! impacts by speed
    integer(c_int), intent(in) :: n_log                             !! room in each log
    real(c_double), intent(inout) :: log(6, n_log, n_points)        !! impacts
    integer(c_int), intent(in) :: n_outcome                         !! outcome columns
    real(c_double), intent(inout) :: outcome(n_outcome, n_points)   !! status, log lines, motion
                                                                    !! state, phi, phi', work
    !f2py threadsafe
    call go_on_with_sweep(knots, coefficients, kinks, series, reals, choices, lines, starts, &
        seconds, n_threads, blobs, cycles, tangent, density, log, outcome)
  end subroutine sweep
end module api
