!> How far a flight goes over table pieces, or over a flank that stands. Where the pieces are
!> parabolas all, and few, also where it ends: nothing but the bend of each enters, since position
!> and velocity are relative to the flank.
module lapwing_flow_exact_piecewise_flights
  use lapwing_kinds, only: wp
  use lapwing_codes, only: no_flank, drive_flank, coast_flank
  use lapwing_flank_table, only: te_table_t
  use lapwing_flow_exact_curve, only: scene_t, curve_t
  use lapwing_flow_exact_flight, only: end_t
  use lapwing_flow_exact_motion, only: fly_to_knot, flight_on_piece, flight_bound
  use lapwing_flow_exact_interval_bounds, only: widest_level, block_at, last_in_block
  use lapwing_polynomial_evaluation, only: max_degree, horner, horner_slope, bernstein_on, largest
  use lapwing_polynomial_roots, only: raise_to_largest, raise_to_turn, raise_to_vertex, &
      is_parabola, parabola_descent
  use lapwing_system, only: instant_t
  implicit none
  private
  public :: farthest_over_pieces, find_bends, flight_over_parabolas, farthest_over_parabolas

contains

  !> Largest sign*x over an arc, if it exceeds `least`; else `least`. On each piece the motion is a
  !> polynomial of degree five.
  pure real(wp) function farthest_over_pieces(scene, curve, sign, until, least) result(most)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve         !! arc, its series known
    real(wp), intent(in) :: sign               !! +1: the largest x, -1: the smallest
    real(wp), intent(in) :: until              !! end of the arc
    real(wp), intent(in) :: least              !! value known already
    real(wp) :: c(0:max_degree), begin, to, x, v
    integer :: piece, next
    most = max(least, sign*curve%x)
    if (scene%blocks%pieces%levels > 1) call look_at_knots(scene, curve, sign, until, &
        scene%blocks%pieces%levels, curve%piece, scene%flank%n, most)
    c = curve%taylor(0:max_degree)
    piece = curve%piece
    begin = 0
    do
      to = min(scene%flank%knot(piece + 1) - curve%t, until)
      call raise_on_piece(sign*c, to - begin, most)
      if (to >= until .or. piece == scene%flank%n) return
      x = horner(c, to - begin)
      v = horner_slope(c, to - begin)
      begin = to
      piece = piece + 1
      ! Off kinks the jump is rounding, but left out it would add up to a mean force.
      v = v - scene%flank%slope_jump(piece)
      if (scene%blocks%pieces%levels > 1) then
        next = piece
        call pass_low_blocks(scene, curve, sign, until, most, next)
        if (next > piece) then
          if (next > scene%flank%n) return
          begin = scene%flank%knot(next) - curve%t
          if (begin >= until) return
          piece = next
          call fly_to_knot(scene, curve, piece, x, v)
        end if
      end if
      c = flight_on_piece(scene, piece, x, v)
    end do
  end function farthest_over_pieces

  !> Raise `most` to the largest sign*x at the ends of blocks of pieces, from one piece to another.
  pure subroutine look_at_knots(scene, curve, sign, until, widest, first, last, most)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve         !! arc
    real(wp), intent(in) :: sign               !! +1 or -1
    real(wp), intent(in) :: until              !! end of the arc
    integer, intent(in) :: widest              !! level of blocks, at most
    integer, intent(in) :: first, last         !! pieces
    real(wp), intent(inout) :: most            !! largest value
    real(wp) :: x, v
    integer :: piece
    piece = first
    associate (row => scene%blocks%pieces)
      do
        piece = last_in_block(row, min(widest, widest_level(row, piece)), piece) + 1
        if (piece > last) return
        if (scene%flank%knot(piece) - curve%t >= until) return
        call fly_to_knot(scene, curve, piece, x, v)
        most = max(most, sign*x)
      end do
    end associate
  end subroutine look_at_knots

  !> From a piece past all blocks on which sign*x stays below `most`. Where it does not, the ends of
  !> the blocks in a block raise that first.
  pure subroutine pass_low_blocks(scene, curve, sign, until, most, piece)
    type(scene_t), intent(in) :: scene
    type(curve_t), intent(in) :: curve         !! arc
    real(wp), intent(in) :: sign               !! +1 or -1
    real(wp), intent(in) :: until              !! end of the arc
    real(wp), intent(inout) :: most            !! largest value known
    integer, intent(inout) :: piece            !! piece, then the one to be looked at next, or n + 1
    real(wp) :: begin, finish, x, v
    integer :: level, block, last
    associate (row => scene%blocks%pieces)
      do while (piece <= scene%flank%n)
        begin = scene%flank%knot(piece) - curve%t
        if (begin >= until) return
        level = widest_level(row, piece)
        if (level > 0) call fly_to_knot(scene, curve, piece, x, v)
        do level = level, 1, -1
          last = last_in_block(row, level, piece)
          finish = min(scene%flank%knot(last + 1) - curve%t, until)
          block = block_at(row, level, piece)
          if (flight_bound(scene, curve, sign, begin, finish, scene%blocks%g_low(block), &
              scene%blocks%g_high(block)) <= most) exit
          if (bound_from(sign*x, sign*v, finish - begin) <= most) exit
          if (level > 1) call look_at_knots(scene, curve, sign, until, level - 1, piece, last, most)
        end do
        if (level == 0) return
        piece = last + 1
      end do
    end associate
  contains
    !> The same from position and velocity at its beginning: an arc has no kink in it.
    pure real(wp) function bound_from(height, rate, length) result(bound)
      real(wp), intent(in) :: height, rate     !! sign*x and its rate
      real(wp), intent(in) :: length           !! of the block
      real(wp) :: push
      push = merge(scene%force + scene%flank%push(2), scene%flank%push(1) - scene%force, sign > 0)
      bound = height + (max(rate, 0.0_wp) + 0.5_wp*max(push, 0.0_wp)*length)*length
    end function bound_from
  end subroutine pass_low_blocks

  !> Raise `most` to the largest value of a polynomial on [0, length].
  pure subroutine raise_on_piece(c, length, most)
    real(wp), intent(in) :: c(0:max_degree)    !! coefficients
    real(wp), intent(in) :: length             !! interval
    real(wp), intent(inout) :: most            !! largest value
    logical :: found
    if (is_parabola(c)) then
      call raise_to_largest(c, length, most)
      return
    end if
    if (largest(bernstein_on(c, length)) <= most) return
    call raise_to_turn(c, 0.0_wp, length, most, found)
    if (found) return
    call raise_to_largest(c, length, most)
  end subroutine raise_on_piece

  !> The bend of each piece of a scene's flank, where all are parabolas and no blocks of them are
  !> bounded together.
  pure subroutine find_bends(scene, error)
    type(scene_t), intent(inout) :: scene      !! its flank and its blocks are known
    integer, intent(out) :: error              !! 0, or there is no memory for them
    error = 0
    select type (flank => scene%flank)
    type is (te_table_t)
      if (scene%blocks%pieces%levels > 0 .or. any(flank%coefficient(3:, :) /= 0)) return
      allocate (scene%bend(flank%n), stat=error)
      if (error == 0) scene%bend(:) = -flank%coefficient(2, :)
    end select
  end subroutine find_bends

  !> How a flight over parabolas ends, by formula.
  pure subroutine flight_over_parabolas(scene, begin, first, wall, stop, at)
    type(scene_t), intent(in) :: scene         !! its bends are known
    type(instant_t), intent(in) :: begin       !! where the flight begins
    integer, intent(in) :: first               !! piece that holds its time
    real(wp), intent(in) :: wall(2)            !! positions of the flanks
    real(wp), intent(in) :: stop               !! latest end
    type(end_t), intent(out) :: at             !! the end
    real(wp) :: x, v, bend, from, to, s, root
    integer :: piece, left
    logical :: found
    x = begin%y(1)
    v = begin%y(2)
    from = 0
    piece = first
    left = begin%touching
    do
      bend = scene%bend(piece) + 0.5_wp*scene%force
      to = min(scene%flank%knot(piece + 1) - begin%t, stop)
      s = to - from
      call parabola_descent([merge(0.0_wp, wall(1) - x, left == drive_flank), -v, -bend], s, &
          left == drive_flank, found, root)
      if (found) then
        at%flank = drive_flank
        s = root
      end if
      call parabola_descent([merge(0.0_wp, x - wall(2), left == coast_flank), v, bend], s, &
          left == coast_flank, found, root)
      if (found) then
        at%flank = coast_flank
        s = root
      end if
      x = (bend*s + v)*s + x
      v = 2*bend*s + v
      if (at%flank /= no_flank .or. to >= stop .or. piece == scene%flank%n) exit
      left = no_flank
      from = to
      piece = piece + 1
      ! Off kinks the jump is rounding, but left out it would add up to a mean force.
      v = v - scene%flank%slope_jump(piece)
    end do
    at%s = merge(stop, from + s, at%flank == no_flank)
    at%x = x
    at%v = v
  end subroutine flight_over_parabolas

  !> Largest sign*x over such a flight, if it exceeds `least`; else `least`.
  pure real(wp) function farthest_over_parabolas(scene, t, first, y, sign, until, least) &
      result(most)
    type(scene_t), intent(in) :: scene         !! its bends are known
    real(wp), intent(in) :: t                  !! cycle time of the flight's beginning
    integer, intent(in) :: first               !! piece that holds it
    real(wp), intent(in) :: y(2)               !! position and velocity then
    real(wp), intent(in) :: sign               !! +1: the largest x, -1: the smallest
    real(wp), intent(in) :: until              !! end of the flight
    real(wp), intent(in) :: least              !! value known already
    real(wp) :: x, v, bend, from, to, s
    integer :: piece
    x = y(1)
    v = y(2)
    most = least
    from = 0
    piece = first
    do
      bend = scene%bend(piece) + 0.5_wp*scene%force
      to = min(scene%flank%knot(piece + 1) - t, until)
      s = to - from
      call raise_to_vertex(sign*[x, v, bend], s, most)
      if (to >= until .or. piece == scene%flank%n) return
      x = (bend*s + v)*s + x
      v = 2*bend*s + v
      from = to
      piece = piece + 1
      v = v - scene%flank%slope_jump(piece)
    end do
  end function farthest_over_parabolas
end module lapwing_flow_exact_piecewise_flights
