!> What Python may call: the only file f2py reads. Flat, one procedure per operation; kinds are C
!> kinds and nothing is optional. Arrays are contiguous: the compiler would pass on copies of others
!> and take for granted that there is memory for them. Layouts: `lapwing.engine`.
!>
!> `flank` is a table, a column for each knot: mesh phase, rad per period**0 to 5, whether the slope
!> jumps (1); or a harmonic series, a column for each term: order, amplitude (rad), shift, four
!> zeros, -1; or a table and behind it the series that it follows to rounding.
module api
  use, intrinsic :: iso_c_binding, only: c_double, c_int
  implicit none
  private
  public :: sizes, trajectory, sweep, destinations, evaluate_table, find_period, code_values
  public :: event_equations, bordered_solution, round_trip, chatter_bounces

contains

  !> Sizes of the arrays that Python allocates.
  subroutine sizes(n)
    use lapwing_api_marshal, only: all_sizes
    integer(c_int), intent(out) :: n(14)  !! blob, work; log, cycle, sample columns; reals, choices;
                                          !! tangent, outcome columns; longest period looked for;
                                          !! goal, end columns, size of a suspended run; columns of
                                          !! averages
    n = all_sizes
  end subroutine sizes

  !> Named codes in the order of `lapwing.codes`, for the test that both sides agree.
  subroutine code_values(values)
    use lapwing_api_marshal, only: all_codes
    integer(c_int), intent(out) :: values(37)   !! the codes
    values = all_codes
  end subroutine code_values

  !> g, g' and g'' of the scaled table at times of the mesh period.
  subroutine evaluate_table(n_knots, flank, scale, period, n, t, g)
    use lapwing_api_marshal, only: evaluate
    integer(c_int), intent(in) :: n_knots                   !! knots
    real(c_double), intent(in) :: flank(8, n_knots)         !! a table
    real(c_double), intent(in) :: scale                     !! g / transmission error
    real(c_double), intent(in) :: period                    !! mesh period in tau
    integer(c_int), intent(in) :: n                         !! times
    real(c_double), intent(in) :: t(n)                      !! times, 0 <= t < period
    real(c_double), intent(out) :: g(3, n)                  !! g, g', g''
    !f2py threadsafe
    call evaluate(flank, scale, period, t, g)
  end subroutine evaluate_table

  !> Period of a motion in mesh cycles, 0 where none is found.
  subroutine find_period(n_rows, n, cycles, scale, most, period)
    use lapwing_api_marshal, only: period_of_rows
    integer(c_int), intent(in) :: n_rows                    !! 2 and the labels
    integer(c_int), intent(in) :: n                         !! cycles
    real(c_double), intent(in) :: cycles(n_rows, n)         !! phi, phi'; labels
    real(c_double), intent(in) :: scale                     !! size of the motion, rad
    integer(c_int), intent(in) :: most                      !! longest period looked for
    integer(c_int), intent(out) :: period                   !! mesh cycles
    !f2py threadsafe
    period = period_of_rows(cycles, scale, most)
  end subroutine find_period

  !> Go on with one trajectory until its target, a full log or the deadline.
  subroutine trajectory(flank, reals, choices, start, until, blob, sample_time, samples, log, &
      cycles, tangent, done)
    use lapwing_api_marshal, only: go_on_with_trajectory
    real(c_double), contiguous, intent(in) :: flank(:, :)         !! transmission error
    real(c_double), contiguous, intent(in) :: reals(:)            !! real parameters
    integer(c_int), contiguous, intent(in) :: choices(:)          !! integer parameters
    real(c_double), contiguous, intent(in) :: start(:)            !! (4) -2 go on, -1 rest, or
                                                                  !! motion state; phi, phi', phase
    real(c_double), contiguous, intent(in) :: until(:)            !! (3) target: cycle, time in it;
                                                                  !! seconds for this call
    real(c_double), contiguous, intent(inout) :: blob(:)          !! run under way
    real(c_double), contiguous, intent(in) :: sample_time(:, :)   !! (2, n) cycle, time; (-1, 0):
                                                                  !! none
    real(c_double), contiguous, intent(inout) :: samples(:, :)    !! (columns, n) motion state, phi,
                                                                  !! phi', the other states
    real(c_double), contiguous, intent(inout) :: log(:, :)        !! (columns, room) events
    real(c_double), contiguous, intent(inout) :: cycles(:, :)     !! (columns, room) statistics by
                                                                  !! cycle
    real(c_double), contiguous, intent(inout) :: tangent(:, :)    !! (columns, room) tangent maps
    real(c_double), intent(out) :: done(9)                        !! status, log lines, cycles,
                                                                  !! cycle, t, motion state, phi,
                                                                  !! phi'; 1: behind the cycles one
                                                                  !! that is not complete
    !f2py threadsafe
    call go_on_with_trajectory(flank, reals, choices, start, until, blob, sample_time, samples, &
        log, cycles, tangent, done)
  end subroutine trajectory

  !> Go on with a sweep until it is done or the deadline has come.
  subroutine sweep(flank, reals, choices, lines, starts, within, blobs, cycles, tangent, density, &
      log, outcome)
    use lapwing_api_marshal, only: go_on_with_sweep
    real(c_double), contiguous, intent(in) :: flank(:, :, :)      !! transmission errors, behind the
                                                                  !! columns of each NaN
    real(c_double), contiguous, intent(in) :: reals(:, :)         !! (n_reals, points) real
                                                                  !! parameters
    integer(c_int), contiguous, intent(in) :: choices(:)          !! integer parameters
    integer(c_int), contiguous, intent(inout) :: lines(:, :)      !! (5, lines) first, last,
                                                                  !! carried, point, stage
    real(c_double), contiguous, intent(in) :: starts(:, :)        !! (4, lines) -1 rest, or motion
                                                                  !! state; phi, phi', phase
    real(c_double), contiguous, intent(in) :: within(:)           !! (2) seconds for this call,
                                                                  !! threads
    real(c_double), contiguous, intent(inout) :: blobs(:, :)      !! (size, lines) runs under way
    real(c_double), contiguous, intent(inout) :: cycles(:, :, :)  !! (columns, record, points)
    real(c_double), contiguous, intent(inout) :: tangent(:, :, :) !! (columns, record, points), or
                                                                  !! one
    real(c_double), contiguous, intent(inout) :: density(:, :)    !! (bins, points) impacts by
                                                                  !! speed, or one
    real(c_double), contiguous, intent(inout) :: log(:, :, :)     !! (columns, room, points) impacts
    real(c_double), contiguous, intent(inout) :: outcome(:, :)    !! (columns, points) how each
                                                                  !! ended
    !f2py threadsafe
    call go_on_with_sweep(flank, reals, choices, lines, starts, within, blobs, cycles, tangent, &
        density, log, outcome)
  end subroutine sweep

  !> Go on with finding out where motions of one oscillator end.
  subroutine destinations(flank, reals, choices, limits, goals, box, cells, starts, seconds, &
      suspended, ends)
    use lapwing_api_marshal, only: go_on_with_destinations
    real(c_double), contiguous, intent(in) :: flank(:, :)         !! transmission error
    real(c_double), contiguous, intent(in) :: reals(:)            !! real parameters
    integer(c_int), contiguous, intent(in) :: choices(:)          !! integer parameters
    integer(c_int), contiguous, intent(in) :: limits(:)           !! (3) cycles of a run, returns,
                                                                  !! recurrences
    real(c_double), contiguous, intent(in) :: goals(:, :)         !! (columns, n) states of known
                                                                  !! periodic motions
    real(c_double), contiguous, intent(in) :: box(:)              !! (4) phi, phi' that cells span
    integer(c_int), contiguous, intent(in) :: cells(:, :)         !! aperiodic motion of each cell
    real(c_double), contiguous, intent(in) :: starts(:, :)        !! (4, n) -1 rest, or motion
                                                                  !! state; phi, phi', phase
    real(c_double), intent(in) :: seconds                         !! for this call
    real(c_double), contiguous, intent(inout) :: suspended(:)     !! next start; its run under way
    real(c_double), contiguous, intent(inout) :: ends(:, :)       !! (columns, n) how each ended
    !f2py threadsafe
    call go_on_with_destinations(flank, reals, choices, limits, goals, box, cells, starts, &
        seconds, suspended, ends)
  end subroutine destinations
  !> Equations of a periodic motion between its events, their derivatives; branch/equations.f90.
  subroutine event_equations(knots, g, edges, q, first, terms, reals, choices, layout, z, &
      residual, blocks)
    use lapwing_api_branches, only: motion_equations
    real(c_double), contiguous, intent(in) :: knots(:)            !! phases; one: a series
    real(c_double), contiguous, intent(in) :: g(:, :, :)          !! (6, powers, pieces) of g, g'
    real(c_double), contiguous, intent(in) :: edges(:)            !! phases of the response's steps
    real(c_double), contiguous, intent(in) :: q(:, :, :)          !! (2, powers, steps) response
    real(c_double), contiguous, intent(in) :: first(:)            !! first step of each piece, or
                                                                  !! one number
    real(c_double), contiguous, intent(in) :: terms(:, :)         !! (5, terms) of a series: order,
                                                                  !! g, response; real, imaginary
    real(c_double), contiguous, intent(in) :: reals(:)            !! period, force, restitution,
                                                                  !! gap, damping ratio, scale;
                                                                  !! (n) slope jumps at kinks
    integer(c_int), contiguous, intent(in) :: choices(:)          !! back flank moves, `absolute`,
                                                                  !! impacts at all, mesh cycles
    integer(c_int), contiguous, intent(in) :: layout(:, :)        !! (4, n) kind, flank, piece, arc
    real(c_double), contiguous, intent(in) :: z(:)                !! (2 n + 1) unknowns
    real(c_double), contiguous, intent(inout) :: residual(:, :)   !! (2, n)
    real(c_double), contiguous, intent(inout) :: blocks(:, :, :, :)  !! (2, 2, n, 2) derivatives
                                                                  !! by the event before, the event
    !f2py threadsafe
    call motion_equations(knots, g, edges, q, first, terms, reals, choices, layout, z, residual, &
        blocks)
  end subroutine event_equations

  !> Solution of such equations with a column and a row more; branch/bordered.f90.
  subroutine bordered_solution(one, two, column, row, right, work, solution)
    use lapwing_api_branches, only: solve_bordered
    real(c_double), contiguous, intent(in) :: one(:, :, :)        !! (2, 2, n) by the event before
    real(c_double), contiguous, intent(in) :: two(:, :, :)        !! (2, 2, n) by the event
    real(c_double), contiguous, intent(in) :: column(:)           !! (2 n)
    real(c_double), contiguous, intent(in) :: row(:)              !! (2 n + 1)
    real(c_double), contiguous, intent(in) :: right(:)            !! (2 n + 1)
    real(c_double), contiguous, intent(inout) :: work(:, :, :)    !! (2, 8, n)
    real(c_double), contiguous, intent(inout) :: solution(:)      !! (2 n + 1)
    !f2py threadsafe
    call solve_bordered(one, two, column, row, right, work, solution)
  end subroutine bordered_solution

  !> Trace, determinant and rank of the map of a deviation once round.
  subroutine round_trip(one, two, found)
    use lapwing_api_branches, only: trace_and_det
    real(c_double), contiguous, intent(in) :: one(:, :, :)        !! (2, 2, n) by the event before
    real(c_double), contiguous, intent(in) :: two(:, :, :)        !! (2, 2, n) by the event
    real(c_double), intent(out) :: found(3)                       !! the three
    !f2py threadsafe
    call trace_and_det(one, two, found)
  end subroutine round_trip

  !> Bounces that die out, listed; branch/chatter.f90.
  subroutine chatter_bounces(knots, g, terms, reals, choices, flank, piece, at, phases, speeds, &
      count)
    use lapwing_api_branches, only: bounces_between
    real(c_double), contiguous, intent(in) :: knots(:)            !! as of `event_equations`
    real(c_double), contiguous, intent(in) :: g(:, :, :)          !! as of `event_equations`
    real(c_double), contiguous, intent(in) :: terms(:, :)         !! as of `event_equations`
    real(c_double), contiguous, intent(in) :: reals(:)            !! as of `event_equations`
    integer(c_int), contiguous, intent(in) :: choices(:)          !! as of `event_equations`
    integer(c_int), intent(in) :: flank                           !! 1 or 2
    integer(c_int), intent(in) :: piece                           !! of the bounce before
    real(c_double), intent(in) :: at(2)                           !! its phase, speed off the flank
    real(c_double), contiguous, intent(inout) :: phases(:)        !! room for them, mesh periods
    real(c_double), contiguous, intent(inout) :: speeds(:)        !! the same, into the flank
    integer(c_int), intent(out) :: count                          !! how many
    !f2py threadsafe
    call bounces_between(knots, g, terms, reals, choices, flank, piece, at, phases, speeds, count)
  end subroutine chatter_bounces

end module api
