!> The system that a method moves, and the memory it takes.
module lapwing_method
  use lapwing_kinds, only: wp, int64
  use lapwing_codes, only: method_exact
  use lapwing_exact_oscillator, only: exact_oscillator
  use lapwing_oscillator, only: oscillator_t, oscillator
  use lapwing_parameters, only: parameters_t
  implicit none
  private
  public :: moved_by, has_room

  !> Bytes of a panel of the closed form and of a knot of a table, with what goes with each.
  real(wp), parameter :: panel_bytes = 700, knot_bytes = 200
  !> A system is copied twice while it is made.
  integer, parameter :: copies = 3

contains

  !> The oscillator, with a closed form or to be moved by steps.
  subroutine moved_by(method, parameters, knots, coefficients, kinks, series, system)
    integer, intent(in) :: method                         !! method_*
    type(parameters_t), intent(in) :: parameters          !! dimensionless parameters
    real(wp), intent(in) :: knots(:)                      !! (n + 1) mesh phase, 0 to 1
    real(wp), intent(in) :: coefficients(0:, :)           !! (0:5, n) rad per mesh period**k
    logical, intent(in) :: kinks(:)                       !! (n) slope jump at knots(i)
    real(wp), intent(in) :: series(:, :)                  !! (3, terms), first order -1: none
    class(oscillator_t), allocatable, intent(out) :: system   !! the oscillator
    if (method == method_exact) then
      allocate (system, source=exact_oscillator(parameters, knots, coefficients, kinks, series))
    else
      allocate (system, source=oscillator(parameters, knots, coefficients, kinks))
    end if
  end subroutine moved_by

  !> Whether there is memory for some systems: tried, since a failed allocation within a copy of a
  !> type would end the process. Panels are bounded before (`lapwing.engine`).
  logical function has_room(method, parameters, knots, series, systems)
    integer, intent(in) :: method                         !! method_*
    type(parameters_t), intent(in) :: parameters          !! dimensionless parameters
    real(wp), intent(in) :: knots(:)                      !! (n + 1) mesh phase, 0 to 1
    real(wp), intent(in) :: series(:, :)                  !! (3, terms), first order -1: none
    integer, intent(in) :: systems                        !! how many at once
    character, allocatable, volatile :: trial(:)   ! else it may be left out
    real(wp) :: rate, bytes
    integer :: error
    associate (p => parameters)
      rate = max(1.0_wp, 2*p%damping_ratio, p%mesh_frequency_ratio*maxval(series(1, :)))
      ! 2 pi/Omega times the rate over 1.31, and a panel for each knot.
      bytes = (panel_bytes + knot_bytes)*size(knots)
      if (method == method_exact) bytes = bytes + panel_bytes*(5*rate/p%mesh_frequency_ratio)
    end associate
    allocate (trial(int(systems*copies*min(bytes, 1e12_wp), int64)), stat=error)
    has_room = error == 0
  end function has_room
end module lapwing_method
