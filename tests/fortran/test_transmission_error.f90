!> The table of the flank's motion: scaling, expansion, jumps, the search for a piece.
program test_transmission_error
  use assertions, only: tally_t
  use lapwing_kinds, only: wp
  use lapwing_polynomial_evaluation, only: horner, horner_slope
  use lapwing_flank, only: locate_piece, piece_at
  use lapwing_flank_table, only: te_table_t, make_table, expand_at
  implicit none

  real(wp), parameter :: knots(4) = [0.0_wp, 0.25_wp, 0.5_wp, 1.0_wp]
  real(wp), parameter :: scale = -1.5_wp, period = 2.0_wp
  type(tally_t) :: tally

  call test_scaling()
  call test_expansion()
  call test_jumps()
  call test_stops()
  call test_locate()
  call test_crowded_knots()
  call test_push()
  call tally%finish()

contains

  !> Three quintics with simple coefficients, values and slopes in phase known by hand.
  function some_table(kinks, felt) result(table)
    logical, intent(in) :: kinks(3)   !! where slope jumps
    real(wp), intent(in) :: felt      !! smallest curvature jump felt
    type(te_table_t) :: table
    real(wp) :: c(0:5, 3)
    integer :: error
    c(:, 1) = [1.0_wp, 2.0_wp, -4.0_wp, 8.0_wp, 16.0_wp, -32.0_wp]
    c(:, 2) = [-1.0_wp, 0.5_wp, 1.0_wp, 0.0_wp, 4.0_wp, 2.0_wp]
    c(:, 3) = [0.25_wp, -3.0_wp, 2.0_wp, 1.0_wp, -1.0_wp, 0.5_wp]
    call make_table(knots, c, kinks, scale, period, felt, table, error)
  end function some_table

  !> g(t) = scale*TE(t/period): powers of two, hence exact.
  subroutine test_scaling()
    type(te_table_t) :: table
    real(wp) :: g, slope
    table = some_table([.true., .false., .false.], 0.0_wp)
    call tally%equal(table%n, 3, "pieces")
    call tally%below(maxval(abs(table%knot - [0.0_wp, 0.5_wp, 1.0_wp, 2.0_wp])), 0.0_wp, "knots")
    call tally%below(maxval(abs(table%coefficient(:, 1) &
        - scale*[1.0_wp, 1.0_wp, -1.0_wp, 1.0_wp, 1.0_wp, -1.0_wp])), 0.0_wp, "coefficients")
    ! First piece in t: 1 + t - t**2 + t**3 + t**4 - t**5 at 1/4, all times the scale.
    call table%motion(0.25_wp, 3, g, slope)
    call tally%near(g, scale*1235.0_wp/1024, 0.0_wp, "flank position")
    call tally%near(slope, scale*187.0_wp/256, 0.0_wp, "flank velocity")
  end subroutine test_scaling

  !> The expansion about any t is the same polynomial: at most 6 terms of size below 8*scale, two
  !> roundings each, here bounded by 100 units.
  subroutine test_expansion()
    real(wp), parameter :: rounding = 100*8*epsilon(1.0_wp)
    type(te_table_t) :: table
    real(wp) :: local(0:5), t, x, g, slope
    integer :: i, piece
    table = some_table([.false., .false., .false.], 0.0_wp)
    do i = 0, 199
      t = 0.01_wp*i
      piece = locate_piece(table, t, 1)
      call expand_at(table, piece, t, local)
      call table%motion(t, 1, g, slope)
      call tally%near(local(0), g, rounding, "expansion: value")
      call tally%near(local(1), slope, rounding, "expansion: slope")
      x = 0.6_wp*(table%knot(piece + 1) - t)
      call table%motion(t + x, piece, g, slope)
      call tally%near(horner(local, x), g, rounding, "expansion: value further on")
      call tally%near(horner_slope(local, x), slope, rounding, "expansion: slope further on")
    end do
    call expand_at(table, 2, 0.5_wp, local)
    call tally%below(maxval(abs(local - table%coefficient(:, 2))), 0.0_wp, "expansion at a knot")
  end subroutine test_expansion

  !> Slopes on both sides of each knot, by hand: in phase the pieces end with slopes
  !> 2 - 2 + 3/2 + 1 - 5/8, 1/2 + 1/2 + 1/4 + 5/128 and -3 + 2 + 3/4 - 1/2 + 5/32.
  subroutine test_jumps()
    real(wp), parameter :: per_tau = scale/period
    type(te_table_t) :: table
    table = some_table([.true., .true., .false.], 0.0_wp)
    call tally%near(table%slope_jump(1), per_tau*(2 + 0.59375_wp), 0.0_wp, "jump at the wrap")
    call tally%near(table%slope_jump(2), per_tau*(0.5_wp - 1.875_wp), 0.0_wp, "jump at knot 2")
    call tally%near(table%slope_jump(3), per_tau*(-3 - 1.2890625_wp), 0.0_wp, "jump at knot 3")
    call tally%near(table%slope_jump(4), table%slope_jump(1), 0.0_wp, "the wrap is one knot")
    call tally%is_true(table%kink(4) .and. table%kink(1) .and. .not. table%kink(3), "kinks")
  end subroutine test_jumps

  !> Where steps must end: kinks, the end of the table, in contact also felt curvature jumps.
  subroutine test_stops()
    type(te_table_t) :: table
    real(wp) :: jump_2, jump_3
    ! g'' in phase: piece 1 ends with -8 + 12 + 12 - 10 = 6, piece 2 begins with 2 and ends with
    ! 2 + 3 + 5/8 = 5.625, piece 3 begins with 4.
    jump_2 = abs(scale)/period**2*4
    jump_3 = abs(scale)/period**2*1.625_wp
    table = some_table([.false., .false., .false.], 2*jump_2)
    call tally%is_true(all(table%next_kink == 4), "no kink: to the end")
    call tally%is_true(all(table%next_felt == 4), "nothing felt: to the end")
    table = some_table([.false., .false., .false.], 0.5_wp*(jump_2 + jump_3))
    call tally%is_true(all(table%next_felt == [2, 4, 4]), "the larger jump is felt")
    call tally%is_true(all(table%next_kink == 4), "a felt jump is no kink")
    table = some_table([.false., .false., .false.], 0.5_wp*jump_3)
    call tally%is_true(all(table%next_felt == [2, 3, 4]), "both jumps are felt")
    table = some_table([.true., .false., .true.], 2*jump_2)
    call tally%is_true(all(table%next_kink == [3, 3, 4]), "to the kink")
    call tally%is_true(all(table%next_felt == [3, 3, 4]), "a kink is felt")
    call table%feel(0.5_wp*jump_3)
    call tally%is_true(all(table%next_felt == [2, 3, 4]), "asked again, more is felt")
    call table%feel(2*jump_2)
    call tally%is_true(all(table%next_felt == [3, 3, 4]), "and nothing but the kink once more")
  end subroutine test_stops

  !> From every guess, at and next to every knot, and outside.
  subroutine test_locate()
    type(te_table_t) :: table
    integer :: guess, i
    table = some_table([.false., .false., .false.], 0.0_wp)
    do guess = -1, 6
      do i = 1, 3
        call tally%equal(locate_piece(table, table%knot(i), guess), i, "at a knot")
        call tally%equal(locate_piece(table, nearest(table%knot(i + 1), -1.0_wp), guess), i, &
            "just before a knot")
        call tally%equal(locate_piece(table, nearest(table%knot(i), 1.0_wp), guess), i, &
            "just after a knot")
      end do
      call tally%equal(locate_piece(table, period, guess), 3, "at the end of the table")
      call tally%equal(locate_piece(table, 1.1_wp*period, guess), 3, "beyond the table")
    end do
  end subroutine test_locate

  !> Half of the knots in a thousandth of the period: at, before and after each of them.
  subroutine test_crowded_knots()
    integer, parameter :: n = 40
    type(te_table_t) :: table
    real(wp) :: crowded(n + 1), c(0:5, n)
    integer :: i
    integer :: error
    c = 1
    crowded = [(real(i, wp)/n, i = 0, n)]
    crowded(n/4:3*n/4) = 0.3_wp + [(1.0e-3_wp*i/n, i = n/4, 3*n/4)]
    call make_table(crowded, c, spread(.false., 1, n), 1.0_wp, 0.7_wp, 0.0_wp, table, error)
    do i = 1, n
      call tally%equal(piece_at(table, table%knot(i)), i, "at a crowded knot")
      call tally%equal(piece_at(table, nearest(table%knot(i + 1), -1.0_wp)), i, "just before one")
      call tally%equal(piece_at(table, 0.5_wp*(table%knot(i) + table%knot(i + 1))), i, "between")
    end do
    call tally%equal(piece_at(table, 0.7_wp), n, "at the end")
    call tally%equal(piece_at(table, 0.8_wp), n, "beyond the end")
  end subroutine test_crowded_knots

  !> g'' is nowhere beyond what it is said to push with. A parabola pushes with its one curvature.
  subroutine test_push()
    type(te_table_t) :: table
    real(wp) :: c(0:5, 1), before, at, after
    integer :: i
    real(wp), parameter :: h = 1.0e-4_wp
    integer :: error
    table = some_table([.true., .true., .true.], 0.0_wp)
    do i = 1, 3
      associate (x => 0.5_wp*(table%knot(i + 1) - table%knot(i)), p => table%coefficient(:, i))
        before = horner(p, x - h)
        at = horner(p, x)
        after = horner(p, x + h)
      end associate
      call tally%below((after - 2*at + before)/h**2, table%push(1) + 1.0e-6_wp, "outwards")
      call tally%below(-(after - 2*at + before)/h**2, table%push(2) + 1.0e-6_wp, "inwards")
    end do
    c = 0
    c(2, 1) = 3
    call make_table([0.0_wp, 1.0_wp], c, [.true.], scale, period, 0.0_wp, table, error)
    call tally%near(table%push(1), -2.25_wp, 0.0_wp, "a parabola")
    call tally%near(table%push(2), 2.25_wp, 0.0_wp, "a parabola, inwards")
  end subroutine test_push
end program test_transmission_error
