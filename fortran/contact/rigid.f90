!> Impacts with restitution on a flank that does not yield: a tooth at rest on it follows it.
module lapwing_contact_rigid
  use lapwing_contact_impact, only: relative_impact_t
  implicit none
  private
  public :: rigid_t

  type, extends(relative_impact_t) :: rigid_t
  contains
    procedure :: is_rigid => yes
  end type rigid_t

contains

  pure logical function yes(self)
    class(rigid_t), intent(in) :: self
    yes = .true.
  end function yes
end module lapwing_contact_rigid
