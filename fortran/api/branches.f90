!> Between the flat arrays of the API and the equations of periodic motions.
module lapwing_api_branches
  use, intrinsic :: iso_c_binding, only: c_double, c_int
  use lapwing_branch_bordered, only: solve_bordered, once_round
  use lapwing_branch_chatter, only: ball_t, bounces_of
  use lapwing_branch_curve, only: curve_t, curve_of
  use lapwing_branch_equations, only: motion_t, equations_of
  implicit none
  private
  public :: motion_equations, solve_bordered, trace_and_det, bounces_between

contains

  !> Residuals of a motion's events and their derivatives, and those of the map once round.
  subroutine motion_equations(knots, g, edges, q, first, terms, reals, choices, layout, z, &
      residual, blocks)
    real(c_double), contiguous, intent(in) :: knots(:), g(:, :, :)    !! of `curve_t`
    real(c_double), contiguous, intent(in) :: edges(:), q(:, :, :)    !! of `curve_t`
    real(c_double), contiguous, intent(in) :: first(:), terms(:, :)   !! of `curve_t`
    real(c_double), contiguous, intent(in) :: reals(:)                !! see `ball_of`
    integer(c_int), contiguous, intent(in) :: choices(:)              !! see `ball_of`
    integer(c_int), contiguous, intent(in) :: layout(:, :)            !! (4, n)
    real(c_double), contiguous, intent(in) :: z(:)                    !! (2 n) or more
    real(c_double), contiguous, intent(inout) :: residual(:, :)       !! (2, n)
    real(c_double), contiguous, intent(inout) :: blocks(:, :, :, :)   !! (2, 2, n, 2)
    type(motion_t) :: motion
    motion = motion_t(curve_of(reals(1), knots, g, edges, q, first, terms), &
        ball_of(reals, choices), xi=reals(5), absolute=choices(2) /= 0, struck=choices(3) /= 0, &
        cycles=choices(4), scale=reals(6))
    call equations_of(motion, layout, reals(7:), z, residual, blocks(:, :, :, 1), &
        blocks(:, :, :, 2))
  end subroutine motion_equations

  !> Trace, determinant and rank of the map once round.
  subroutine trace_and_det(one, two, found)
    real(c_double), contiguous, intent(in) :: one(:, :, :), two(:, :, :)   !! (2, 2, n)
    real(c_double), intent(out) :: found(3)                                !! the three
    integer :: rank
    call once_round(one, two, found(1), found(2), rank)
    found(3) = rank
  end subroutine trace_and_det

  !> Bounces that die out after one that is at a phase, on a piece, and leaves with a speed.
  subroutine bounces_between(knots, g, terms, reals, choices, flank, piece, at, phases, speeds, &
      count)
    real(c_double), contiguous, intent(in) :: knots(:), g(:, :, :)    !! of `curve_t`
    real(c_double), contiguous, intent(in) :: terms(:, :)             !! of `curve_t`
    real(c_double), contiguous, intent(in) :: reals(:)                !! see `ball_of`
    integer(c_int), contiguous, intent(in) :: choices(:)              !! see `ball_of`
    integer(c_int), intent(in) :: flank, piece                        !! where
    real(c_double), intent(in) :: at(2)                               !! phase, speed
    real(c_double), contiguous, intent(inout) :: phases(:), speeds(:) !! room for them
    integer(c_int), intent(out) :: count                              !! how many
    type(curve_t) :: curve
    curve = curve_of(reals(1), knots, g, knots, g, knots, terms)
    call bounces_of(curve, ball_of(reals, choices), flank, at(1), piece, at(2), phases, speeds, &
        count)
  end subroutine bounces_between

  pure type(ball_t) function ball_of(reals, choices) result(ball)
    real(c_double), intent(in) :: reals(:)      !! period, force, restitution, gap, xi, scale
    integer(c_int), intent(in) :: choices(:)    !! back flank moves, `absolute`, impacts, cycles
    ball%force = reals(2)
    ball%restitution = reals(3)
    ball%gap = reals(4)
    ball%back_moves = choices(1) /= 0
  end function ball_of

end module lapwing_api_branches
