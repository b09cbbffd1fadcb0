!> What every kind of flank promises: its Taylor polynomial, its range over an interval, its bounds.
program test_flanks
  use assertions, only: tally_t
  use exact_reference, only: seed, uniform, random_table, random_series
  use lapwing_flank, only: flank_t, locate_piece
  use lapwing_flank_fixed, only: fixed_flank_t, make_fixed_flank
  use lapwing_flank_series, only: series_flank_t, make_series_flank, harmonic_series
  use lapwing_flank_table, only: te_table_t, make_table
  use lapwing_kinds, only: wp
  use lapwing_polynomial_evaluation, only: max_degree, horner, horner_slope
  implicit none

  real(wp), parameter :: two_pi = 8*atan(1.0_wp), eps = epsilon(1.0_wp)
  integer, parameter :: n_flanks = 200, n_samples = 40
  type(tally_t) :: tally

  call seed(20261129)
  call test_tables()
  call test_series()
  call test_fixed()
  call tally%finish()

contains

  subroutine test_tables()
    type(te_table_t) :: table
    real(wp), allocatable :: knots(:), coefficients(:, :)
    logical, allocatable :: kinks(:)
    integer :: i, error
    do i = 1, n_flanks
      call random_table(1 + int(uniform(0.0_wp, 9.0_wp)), 0.5_wp, knots, coefficients, kinks)
      call make_table(knots, coefficients, kinks, 1.0_wp, uniform(1.0_wp, 9.0_wp), 0.0_wp, table, &
          error)
      call tally%equal(error, 0, "table made")
      call check(table, 0.0_wp, "table")
    end do
  end subroutine test_tables

  !> The seventh term of a Taylor series is what its first six leave out.
  subroutine test_series()
    type(series_flank_t) :: flank
    real(wp) :: period
    integer :: i, error
    do i = 1, n_flanks
      period = uniform(1.0_wp, 9.0_wp)
      call make_series_flank(harmonic_series(random_series(1 + int(uniform(0.0_wp, 4.0_wp))), &
          1.0_wp, two_pi/period), period, flank, error)
      call tally%equal(error, 0, "series made")
      call check(flank, sum(hypot(flank%series%cosine, flank%series%sine) &
          *flank%series%rate**6)/720, "series")
      call tally%is_true(.not. any(flank%kink) .and. all(flank%slope_jump == 0), "series is smooth")
    end do
  end subroutine test_series

  subroutine test_fixed()
    type(fixed_flank_t) :: flank
    real(wp) :: g, slope
    integer :: error
    call make_fixed_flank(3.0_wp, flank, error)
    call tally%equal(error, 0, "fixed flank made")
    call check(flank, 0.0_wp, "fixed")
    call flank%motion(1.2_wp, 1, g, slope)
    call tally%is_true(g == 0 .and. slope == 0 .and. all(flank%push == 0), "fixed flank stands")
    call tally%is_true(flank%knot(flank%next_kink(1)) == 3, "fixed flank: next stop")
  end subroutine test_fixed

  !> On a part of a piece that holds both times: Taylor polynomial and motion agree, the range holds
  !> the samples and is not much wider than twice their spread, accelerations are below the push.
  subroutine check(flank, sixth, what)
    class(flank_t), intent(in) :: flank      !! flank
    real(wp), intent(in) :: sixth            !! bound of |g^(6)|/6!
    character(*), intent(in) :: what         !! its kind
    real(wp) :: c(0:max_degree), from, width, s, g, slope, low, high, allowed, least, most
    integer :: piece, i
    s = uniform(0.0_wp, 1.0_wp)*flank%knot(flank%n + 1)
    piece = locate_piece(flank, s, 1)
    from = s - flank%knot(piece)
    width = uniform(0.0_wp, 0.3_wp)*(flank%knot(piece + 1) - s)
    call flank%taylor(piece, s, c)
    call flank%range(piece, from, width, low, high)
    least = huge(least)
    most = -huge(most)
    do i = 0, n_samples
      call flank%motion(s + (i*width)/n_samples, piece, g, slope)
      ! Of the time, rounded against the period, and of the terms.
      allowed = 200*eps*(1 + sum(abs(c)))*(1 + flank%knot(flank%n + 1))
      call tally%near(horner(c, (i*width)/n_samples), g, allowed + sixth*width**6, what//": g")
      call tally%near(horner_slope(c, (i*width)/n_samples), slope, allowed*(1 + sum(abs(c))) &
          + 6*sixth*width**5, what//": g'")
      call tally%below(low, g + allowed, what//": low end of its range")
      call tally%below(g, high + allowed, what//": high end of its range")
      call tally%below(flank%lower_bound(), g + allowed, what//": lower bound")
      least = min(least, g)
      most = max(most, g)
    end do
    call tally%below(2*c(2), flank%push(1) + allowed, what//": push upwards")
    call tally%below(-2*c(2), flank%push(2) + allowed, what//": push downwards")
    call tally%below(high - low, 2*(most - least) + 2*sixth*width**6 + allowed &
        + sum(abs(c(2:))*[(width**i, i = 2, max_degree)]), what//": width of its range")
  end subroutine check
end program test_flanks
