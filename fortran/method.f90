!> Which system a method moves.
module lapwing_method
  use lapwing_kinds, only: wp
  use lapwing_codes, only: method_exact
  use lapwing_exact_oscillator, only: exact_oscillator
  use lapwing_oscillator, only: oscillator_t, oscillator
  use lapwing_parameters, only: parameters_t
  implicit none
  private
  public :: moved_by

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
end module lapwing_method
