!> The one real kind of the engine.
module lapwing_kinds
  use, intrinsic :: iso_fortran_env, only: int64, real64
  implicit none
  private
  public :: wp, int64

  !> Working precision. Every other module takes its reals from here, so that one line changes it.
  integer, parameter :: wp = real64
end module lapwing_kinds
