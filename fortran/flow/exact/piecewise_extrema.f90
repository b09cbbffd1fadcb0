!> How far a flight goes over table pieces, or over a flank that stands.
module lapwing_flow_exact_piecewise_extrema
  use lapwing_kinds, only: wp
  use lapwing_flow_exact_curve, only: scene_t, curve_t
  use lapwing_flow_exact_motion, only: fly_to_knot, flight_on_piece, flight_bound
  use lapwing_flow_exact_interval_bounds, only: widest_level, block_at, last_in_block
  use lapwing_polynomial_evaluation, only: max_degree, horner, horner_slope, bernstein_on, largest
  use lapwing_polynomial_roots, only: raise_to_largest, raise_to_turn, is_parabola
  implicit none
  private
  public :: farthest_over_pieces

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
end module lapwing_flow_exact_piecewise_extrema
