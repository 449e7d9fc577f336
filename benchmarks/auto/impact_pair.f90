! The 1:1 orbit of the inclined impact pair as an algebraic problem (IPS = 0), in one parameter.
!
! Unknowns U = (t1, v1, t2, v2): time of the impact at the bottom and the velocity before it, the
! same at the top. PAR(1) = s is the length of the capsule in metres. In units of the half period of
! the forcing, with restitution r, the flight that leaves an impact at (t0, v0) arrives at (t1, v1)
! after h = t1 - t0 if
!
!   -r v0 h + g h^2/2 - (cos(pi t1) - cos(pi t0))/pi^2 - h sin(pi t0)/pi = x
!   -r v0   + g h     + (sin(pi t1) - sin(pi t0))/pi                     = v1
!
! where x = -d from bottom to top, x = d from top to bottom, and the last impact is the first one, a
! forcing period of 2 later. Force A, mass M, frequency omega and slope beta make
!
!   d = M omega^2 s/(A pi^2),   g = M 9.8 sin(beta)/A.

MODULE impact_pair
  IMPLICIT NONE
  DOUBLE PRECISION, PARAMETER :: PI = 3.14159265358979323846D0
  DOUBLE PRECISION, PARAMETER :: A = 5D0, M = 0.1245D0, OMEGA = 5D0*PI, R = 0.3D0, PERIOD = 2D0
  DOUBLE PRECISION, PARAMETER :: DD_DS = M*OMEGA**2/(A*PI**2)
CONTAINS

  ! Residual of one flight.
  SUBROUTINE FLIGHT(t0, v0, t1, v1, x, F)
    DOUBLE PRECISION, INTENT(IN) :: t0, v0, t1, v1, x
    DOUBLE PRECISION, INTENT(OUT) :: F(2)
    DOUBLE PRECISION g, h
    g = M*9.8D0*SIN(PI/6D0)/A
    h = t1 - t0
    F(1) = -R*v0*h + g*h*h/2 - (COS(PI*t1) - COS(PI*t0))/PI**2 - h*SIN(PI*t0)/PI - x
    F(2) = -R*v0 + g*h + (SIN(PI*t1) - SIN(PI*t0))/PI - v1
  END SUBROUTINE FLIGHT

  ! Its derivatives by (t0, v0) and by (t1, v1).
  SUBROUTINE DFLIGHT(t0, v0, t1, START, ARRIVAL)
    DOUBLE PRECISION, INTENT(IN) :: t0, v0, t1
    DOUBLE PRECISION, INTENT(OUT) :: START(2, 2), ARRIVAL(2, 2)
    DOUBLE PRECISION g, h
    g = M*9.8D0*SIN(PI/6D0)/A
    h = t1 - t0
    START(1, 1) = R*v0 - g*h - h*COS(PI*t0)
    START(1, 2) = -R*h
    START(2, 1) = -g - COS(PI*t0)
    START(2, 2) = -R
    ARRIVAL(1, 1) = -R*v0 + g*h + (SIN(PI*t1) - SIN(PI*t0))/PI
    ARRIVAL(1, 2) = 0D0
    ARRIVAL(2, 1) = g + COS(PI*t1)
    ARRIVAL(2, 2) = -1D0
  END SUBROUTINE DFLIGHT
END MODULE impact_pair

SUBROUTINE FUNC(NDIM, U, ICP, PAR, IJAC, F, DFDU, DFDP)
  USE impact_pair
  IMPLICIT NONE
  INTEGER, INTENT(IN) :: NDIM, ICP(*), IJAC
  DOUBLE PRECISION, INTENT(IN) :: U(NDIM), PAR(*)
  DOUBLE PRECISION, INTENT(OUT) :: F(NDIM)
  DOUBLE PRECISION, INTENT(INOUT) :: DFDU(NDIM, NDIM), DFDP(NDIM, *)
  DOUBLE PRECISION d

  d = DD_DS*PAR(1)
  CALL FLIGHT(U(1), U(2), U(3), U(4), -d, F(1:2))
  CALL FLIGHT(U(3), U(4), U(1) + PERIOD, U(2), d, F(3:4))
  IF (IJAC == 0) RETURN

  CALL DFLIGHT(U(1), U(2), U(3), DFDU(1:2, 1:2), DFDU(1:2, 3:4))
  CALL DFLIGHT(U(3), U(4), U(1) + PERIOD, DFDU(3:4, 3:4), DFDU(3:4, 1:2))
  IF (IJAC == 1) RETURN

  DFDP(1:4, 1) = [DD_DS, 0D0, -DD_DS, 0D0]
END SUBROUTINE FUNC

! The stable orbit at d = 0.45.
SUBROUTINE STPNT(NDIM, U, PAR, T)
  IMPLICIT NONE
  INTEGER, INTENT(IN) :: NDIM
  DOUBLE PRECISION, INTENT(INOUT) :: U(NDIM), PAR(*)
  DOUBLE PRECISION, INTENT(IN) :: T

  PAR(1) = 0.7228915662650602D0
  U = [0.3289672464099905D0, 0.9099069905380301D0, 1.4248536390000661D0, -0.7221992982303381D0]
END SUBROUTINE STPNT

SUBROUTINE BCND
END SUBROUTINE BCND

SUBROUTINE ICND
END SUBROUTINE ICND

SUBROUTINE FOPT
END SUBROUTINE FOPT

SUBROUTINE PVLS
END SUBROUTINE PVLS
